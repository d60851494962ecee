"""The light of a scenario as electron rates: what a virtual bench is fed with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hw_adapters import BenchState, Faults
    from scenarios.scenario import Scenario
    from twin.instrument import Instrument
    from twin.measurement import Truth


@dataclass(frozen=True, eq=False)
class TwinLight:
    """Electron rates of every capture of a scenario.

    Attributes:
        scenario: the scenario, settled.
        instrument: the sensor that looks, with all its pixels.
        rates: (capture, sample) -> signal [electrons/s], shape (P,) each.
        inside: pixels to which the scenario's light reaches, shape (P,); others see none.
        light_se: standard errors of the light transport, shape (S, 3, number of pixels inside).
        truth: the true properties of the samples.
    """

    scenario: Scenario
    instrument: Instrument
    rates: dict[tuple[str, str], FloatArray]
    inside: NDArray[np.bool_]
    light_se: FloatArray
    truth: Truth

    @property
    def range_nm(self) -> tuple[float, float]:
        """First and last wavelength [nm] of the pixels inside."""
        seen = np.asarray(self.instrument.wavelength_nm)[self.inside]
        return float(seen[0]), float(seen[-1])

    def state(self, *, faults: Faults | None = None) -> BenchState:
        """A virtual bench in this light; its seed is the scenario's."""
        from hw_adapters import BenchState

        return BenchState(
            self.instrument,
            self.rates,
            samples=tuple(sample.name for sample in self.scenario.samples),
            seed=self.scenario.simulation.seed,
            faults=faults,
        )


def twin_light(
    scenario: Scenario,
    *,
    instrument: Instrument | None = None,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> TwinLight:
    """Compute the light of a scenario once, by the Monte Carlo of its bench.

    Args:
        scenario: bench, samples, wavelengths, number of paths and seed.
        instrument: the sensor; None takes the scenario's. Pixels beyond the scenario's wavelengths
            see no light.
        threads: threads of the Monte Carlo; the result does not depend on them.
        progress: called with (done, total).

    Raises:
        InputError: no pixel lies within the scenario's wavelengths, or a spectrum does not serve.
    """
    from scenarios import simulate
    from twin.instrument import fine_grid_nm

    sensor = scenario.bench.instrument if instrument is None else instrument
    inside = _inside(scenario, sensor)
    seen = _restricted(sensor, inside)
    narrowed = scenario.model_copy(
        update={"bench": scenario.bench.model_copy(update={"instrument": seen})}
    )
    simulate.check_cover(narrowed)
    noiseless = simulate._transport(narrowed, threads, progress)
    fine = fine_grid_nm(seen)
    rates = {}
    for number, sample in enumerate(scenario.samples):
        for capture, rate in simulate._signals(narrowed, number, fine, noiseless).items():
            if capture != "dark":
                padded = np.zeros(len(inside))
                padded[inside] = rate
                rates[capture, sample.name] = padded
    return TwinLight(
        scenario=narrowed,
        instrument=sensor,
        rates=rates,
        inside=inside,
        light_se=simulate._light_se(
            narrowed, noiseless, fine, np.asarray(seen.wavelength_nm, dtype=np.float64)
        ),
        truth=simulate._truth(narrowed, fine),
    )


def _inside(scenario: Scenario, sensor: Instrument) -> NDArray[np.bool_]:
    """Pixels whose whole response lies within the scenario's wavelengths."""
    pixels = np.asarray(sensor.wavelength_nm, dtype=np.float64)
    if sensor.kind == "chip":
        return np.ones(pixels.shape, dtype=np.bool_)
    grid = scenario.wavelength
    reach = 2.0 * sensor.bandwidth_nm if sensor.has("bandwidth") else 0.0
    inside = (pixels - reach >= grid.start_nm - 1e-6) & (pixels + reach <= grid.stop_nm + 1e-6)
    if not inside.any():
        raise InputError(
            f"a scenario from {grid.start_nm:g} to {grid.stop_nm:g} nm",
            f"wavelengths that the sensor sees, {pixels[0]:g} to {pixels[-1]:g} nm",
            place="wavelength",
        )
    return np.asarray(inside)


def _restricted(sensor: Instrument, inside: NDArray[np.bool_]) -> Instrument:
    if inside.all() or sensor.kind == "chip":
        return sensor
    pixels = tuple(float(value) for value in np.asarray(sensor.wavelength_nm)[inside])
    return sensor.model_copy(update={"pixels_nm": pixels})
