"""Where and how widely the pixels look: wavelength shifts and bandwidth."""

from __future__ import annotations

from collections.abc import Mapping

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import World
from twin.instrument import MultispectralChip


def _shift(world: World, values: Mapping[str, float], instance: str) -> World:
    field = "shift_nm" if instance == "all" else "shift_after_reference_nm"
    return world.changed(**{field: getattr(world, field) + values["shift_nm"]})


def _bandwidth(world: World, values: Mapping[str, float], instance: str) -> World:
    instrument = world.bench.instrument
    if isinstance(instrument, MultispectralChip):
        channels = tuple(
            {**channel.model_dump(), "fwhm_nm": channel.fwhm_nm + values["width_nm"]}
            for channel in instrument.channels
        )
        return world.with_bench(instrument={**instrument.model_dump(), "channels": channels})
    width = instrument.bandwidth_nm + values["width_nm"]
    return world.with_bench(instrument={**instrument.model_dump(), "bandwidth_nm": width})


def _with_bands(world: World) -> tuple[str, ...]:
    return ("",) if world.bench.instrument.has("bandwidth") else ()


SHIFT = Effect(
    name="wavelength_shift",
    place="detector",
    title="the wavelength scale is off",
    physics="A reading belongs to another wavelength than its label says. If all readings are "
    "off alike the spectra of the material are, too, and little shows; if the scale moved "
    "after the references, the flanks of the lamp no longer cancel.",
    source="first order: I + shift dI/dlambda, with the lamp's slope where it does not cancel",
    parameters=(
        EffectParameter("shift_nm", "nm", 0.0, 0.5, description="true minus labelled", limit=10.0),
    ),
    engine="signal",
    change=_shift,
    instances=lambda world: ("all", "after the references"),
)
BANDWIDTH = Effect(
    name="bandwidth",
    place="detector",
    title="the bands are wider than described",
    physics="A wider band averages over more of the lamp and of the spectra: half the added "
    "variance times their second derivative.",
    source="Stearns and Stearns 1988, Color Res. Appl. 13, 257 (bandpass, second order)",
    parameters=(
        EffectParameter(
            "width_nm", "nm", 0.0, 2.0, "positive", "added to the full width", limit=30.0
        ),
    ),
    engine="signal",
    change=_bandwidth,
    instances=_with_bands,
    plain=True,
)
EFFECTS = (SHIFT, BANDWIDTH)
