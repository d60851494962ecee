"""A translucent bench for the benchmark of the instruments, in process and on the wire.

Three thicknesses of the library's `demo_ink`; the light is the twin's Monte Carlo. The lamps shine
from 400 to 700 nm only, so the pixels of a USB650 outside see none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hw_adapters.bench import DeviceBench
from hw_adapters.faults import Faults
from hw_adapters.plan import PlanSettings
from hw_adapters.sequence import capture_visit
from hw_adapters.state import BenchState
from hw_adapters.virtual import (
    VirtualChip,
    VirtualHolder,
    VirtualLights,
    VirtualSpectrometer,
    VirtualStage,
)
from hw_adapters.wire.bench import WireBench, wire_bench
from hw_adapters.wire.usb650_layout import usb650_instrument
from twin.bench import Bench, Sample
from twin.instrument import Instrument, MultispectralChip, Spectrometer
from twin.measurement import Measurement
from twin.spectra import FloatArray

LIT_NM = (400.0, 700.0)
SEEN_NM = (540.0, 560.0)
"""Pixels of the spectrometer that enter the measurement."""
SAMPLES = tuple(
    Sample(name=f"{thickness:g} mm", thickness_mm=thickness, n="water", material="demo_ink")
    for thickness in (0.3, 0.6, 1.2)
)
SEED = 20
SILENCE_S = 0.2
"""Time [s] the adapter of the lamps waits for an answer."""


@dataclass(frozen=True, eq=False)
class World:
    """One bench with its light; states made of it are equal.

    Attributes:
        instrument: the sensor.
        rates: (capture, sample) -> signal [electrons/s], shape (P,).
    """

    instrument: Instrument
    rates: dict[tuple[str, str], FloatArray]

    @property
    def bench(self) -> Bench:
        """The description that goes into the measurement."""
        return Bench(instrument=self.instrument)

    @property
    def facts(self) -> dict[str, Any]:
        """What `DeviceBench` is told beside its devices."""
        return {"range_nm": SEEN_NM} if isinstance(self.instrument, Spectrometer) else {}

    def state(self, seed: int = SEED) -> BenchState:
        """A bench that nobody has touched yet, with nothing armed."""
        return BenchState(
            self.instrument, self.rates, samples=tuple(one.name for one in SAMPLES), seed=seed,
            faults=Faults(),
        )  # fmt: skip


def sensor_in_process(state: BenchState) -> VirtualSpectrometer | VirtualChip:
    """The sensor of seam A, with the step of a USB650."""
    if isinstance(state.instrument, MultispectralChip):
        return VirtualChip(state)
    return VirtualSpectrometer(state, step_s=0.001)


def visit_in_process(world: World, settings: PlanSettings, folder: Path) -> Measurement:
    """A whole visit with the devices of seam A."""
    state = world.state()
    devices = DeviceBench(
        sensor_in_process(state), VirtualLights(state), VirtualStage(state), VirtualHolder(state),
        state.clock, world.bench, SAMPLES, state.announce, "virtual", state.seed, **world.facts,
    )  # fmt: skip
    return capture_visit(devices, settings, folder)


@contextmanager
def connected(world: World) -> Iterator[tuple[WireBench, Callable[[], DeviceBench]]]:
    """The bench of seam B, and what opens its devices through their real drivers."""
    with wire_bench(world.state()) as wire:
        yield wire, lambda: wire.devices(world.bench, SAMPLES, timeout_s=SILENCE_S, **world.facts)


def visit_on_the_wire(world: World, settings: PlanSettings, folder: Path) -> Measurement:
    """A whole visit with the real drivers of seam B."""
    with connected(world) as (_, opened):
        return capture_visit(opened(), settings, folder)


def worlds(*, paths: int) -> dict[str, World]:
    """A USB650 and an AS7341 in front of the same light.

    Args:
        paths: light paths per wavelength.
    """
    from scenarios.light_between import LightBetween
    from twin.transport import captures

    chip = MultispectralChip(range_nm=LIT_NM, atime=99, astep=599)
    unit = usb650_instrument()
    grid = np.linspace(*LIT_NM, 13)
    noiseless = [captures(Bench(), sample, grid, paths=paths, seed=SEED) for sample in SAMPLES]
    seen = [
        LightBetween(Bench(), sample, own) for sample, own in zip(SAMPLES, noiseless, strict=True)
    ]
    heights = [
        one.white_reference_factor / noiseless[0].white_reference_factor for one in noiseless
    ]
    return {
        "spectrometer": World(unit, _rates(_lit(unit), seen, heights, unit)),
        "chip": World(chip, _rates(chip, seen, heights, chip)),
    }


def _lit(unit: Spectrometer) -> Spectrometer:
    """The pixels that the lamps reach, well inside the range by their bandwidth."""
    margin = 4 * unit.bandwidth_nm
    inside = [nm for nm in unit.wavelength_nm if LIT_NM[0] + margin < nm < LIT_NM[1] - margin]
    return unit.model_copy(update={"pixels_nm": tuple(inside)})


def _rates(
    lit: Instrument, seen: list[Any], heights: list[float], whole: Instrument
) -> dict[tuple[str, str], FloatArray]:
    """Signals of every capture; 0 at the pixels of `whole` that are not in `lit`."""
    from twin.instrument import electron_rates, fine_grid_nm
    from twin.materials import lamp, reflectance

    bench, fine = Bench(), fine_grid_nm(lit)
    panels, beam = lamp(bench.panel_spectrum, fine), lamp(bench.beam.spectrum, fine)
    rho_black = reflectance(bench.background.black.reflectance, fine)
    rho_white = reflectance(bench.background.white.reflectance, fine)
    place = np.isin(np.array(whole.wavelength_nm), np.array(lit.wavelength_nm))
    rates = {}
    for sample, between, height in zip(SAMPLES, seen, heights, strict=True):
        black, white, collimated = between.intensities(fine)
        spectra = {
            "white_reference": height * panels * rho_white,
            "black_reference": height * panels * rho_black,
            "black": height * panels * black,
            "white": height * panels * white,
            "beam_reference": beam,
            "collimated": beam * collimated,
        }
        for capture, spectrum in spectra.items():
            from_below = capture in ("beam_reference", "collimated")
            peak = (
                whole.beam_rate_electrons_per_s if from_below else whole.white_rate_electrons_per_s
            )
            rate = np.zeros(place.size)
            rate[place] = electron_rates(
                lit, fine, spectrum, reference=beam if from_below else panels * rho_white,
                peak_rate_electrons_per_s=peak,
            )  # fmt: skip
            rates[capture, sample.name] = rate
    return rates
