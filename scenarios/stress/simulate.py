"""A visit in which every wavelength carries another material: counts, then relative intensities.

The light is the Monte Carlo twin's (`scenarios.stress.light`); shots, lamps, instrument and the
corrections are those of every simulated visit (`scenarios.simulate`, `twin.measurement`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.scenario import Scenario
from scenarios.simulate import noisy_visits
from scenarios.stress.design import derived_seed
from scenarios.stress.plan import StressPlan
from scenarios.worlds import world_visits
from twin.bench import Bench, Sample
from twin.spectra import FloatArray
from twin.toml import validate

if TYPE_CHECKING:
    from twin.effects import World
    from twin.measurement import Measurement, RelativeIntensities
    from twin.transport import NoiselessCaptures


@dataclass(frozen=True, eq=False)
class Taken:
    """One simulated visit as estimators see it.

    Attributes:
        bench: with the instrument of this visit and noise level.
        samples: S of them, without their material.
        intensities: relative intensities, W wavelengths.
        light_share: standard error of the simulated light in units of the whole standard error,
            shape (S, 3, W).
    """

    bench: Bench
    samples: tuple[Sample, ...]
    intensities: RelativeIntensities
    light_share: FloatArray


def visit_bench(bench: Bench, count: int, level: float = 1.0) -> Bench:
    """The bench with a pixel for each of `count` materials and another noise level.

    Pixels are spread evenly over the instrument's range and see their own wavelength only
    (bandwidth off), so that neighbouring materials do not mix. At noise level k a reading counts
    k^2 times fewer electrons and read-out and lamps waver k times as much: every standard deviation
    but that of rounding is k times as large, exposures and counts stay.
    """
    from twin.instrument import Spectrometer

    instrument = bench.instrument
    pixels = np.asarray(instrument.wavelength_nm, dtype=np.float64)
    data = instrument.model_dump(mode="python")
    electrons = 1.0 / level**2
    for name in (
        "electrons_per_count",
        "full_well_electrons",
        "white_rate_electrons_per_s",
        "beam_rate_electrons_per_s",
        "dark_current_electrons_per_s",
    ):
        data[name] *= electrons
    data["read_noise_electrons"] *= electrons * level
    for name in ("lamp_flicker", "lamp_walk", "lamp_tilt_walk"):
        data[name] *= level
    start, stop = float(pixels[0]), float(pixels[-1])
    data |= {
        "pixels_nm": None,
        "start_nm": start,
        "stop_nm": stop,
        "step_nm": (stop - start) / (count - 1),
        "off": tuple(dict.fromkeys((*data["off"], "bandwidth"))),
    }
    return bench.model_copy(update={"instrument": validate(data, Spectrometer)})


def visit_wavelengths(bench: Bench) -> FloatArray:
    """Wavelengths [nm] of the pixels of `visit_bench`, shape (W,)."""
    return np.asarray(bench.instrument.wavelength_nm, dtype=np.float64)


def samples_of(plan: StressPlan) -> tuple[Sample, ...]:
    """One sample for every thickness, without a material."""
    return tuple(
        Sample(name=f"{thickness:g} mm", thickness_mm=thickness, n=plan.n)
        for thickness in plan.thickness_mm
    )


def take(
    plan: StressPlan,
    bench: Bench,
    material: FloatArray,
    light: Sequence[NoiselessCaptures],
    *,
    seed: int,
    world: World | None = None,
) -> Taken:
    """Simulate the noisy visits and correct them.

    The lamps' drift is common to all wavelengths of a visit. So that errors at different points
    are independent, as a count of intervals that hold takes them to be, the visit is simulated
    as often as it has wavelengths, and one wavelength is taken from each. A spectrum is taken in
    one visit, drift and all, as a real one is.

    Args:
        plan: gives samples and protocol.
        bench: from `visit_bench`.
        material: (albedo, sigma_t [1/mm], g) at each wavelength, shape (W, 3).
        light: noiseless captures of every sample.
        seed: of lamps and noise.
        world: what is true, whose light it is; None: as described.

    Raises:
        InputError: the instrument cannot take the protocol's captures.
    """
    from twin.measurement import relative_intensities

    samples = samples_of(plan)
    scenario = _scenario(plan, bench, samples, material)
    seeds = [derived_seed(seed, index) for index in range(len(material))]
    if plan.materials.spectra:
        intensities = relative_intensities(next(_visits(scenario, light, seeds[:1], world)))
    else:
        every = [relative_intensities(m) for m in _visits(scenario, light, seeds, world)]
        intensities = _joined(every)
    own = np.stack([[each.black_se, each.white_se, each.collimated_se] for each in light])
    with np.errstate(invalid="ignore", divide="ignore"):
        light_share = np.asarray(own / intensities.sigma)
    return Taken(bench, samples, intensities, light_share)


def _visits(
    scenario: Scenario,
    light: Sequence[NoiselessCaptures],
    seeds: Sequence[int],
    world: World | None,
) -> Iterator[Measurement]:
    if world is None or not world.applied:
        return noisy_visits(scenario, light, seeds)
    return world_visits(scenario, world, light, seeds)


def _joined(every: Sequence[RelativeIntensities]) -> RelativeIntensities:
    """Wavelength w of visit w, for all of them."""
    first, each = every[0], range(len(every))
    valid = np.stack([every[w].valid[..., w] for w in each], axis=-1)
    # What was counted over a whole visit is counted again over the wavelengths that were taken.
    reasons = [reason for reason in first.reasons if not reason[:1].isdigit()]
    if not valid.all():
        reasons.append(f"{int((~valid).sum())} of {valid.size} values masked")
    return replace(
        first,
        value=np.stack([every[w].value[..., w] for w in each], axis=-1),
        covariance=np.stack([every[w].covariance[w] for w in each]),
        valid=valid,
        reasons=tuple(reasons),
        common=None,
    )


def _scenario(
    plan: StressPlan, bench: Bench, samples: Sequence[Sample], material: FloatArray
) -> Scenario:
    wavelength = visit_wavelengths(bench).tolist()
    names = ("albedo", "sigma_t_per_mm", "g")
    medium: dict[str, Any] = {
        name: {"wavelength_nm": wavelength, "value": column.tolist()}
        for name, column in zip(names, material.T, strict=True)
    }
    instrument = bench.instrument.model_dump(mode="python")
    data = {
        "title": plan.title,
        "bench": bench.model_dump(mode="python"),
        "samples": [sample.model_dump(mode="python") | {"material": medium} for sample in samples],
        "wavelength": {name: instrument[name] for name in ("start_nm", "stop_nm", "step_nm")},
        "protocol": plan.protocol.model_dump(mode="python"),
    }
    return validate(data, Scenario)
