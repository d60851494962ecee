"""What is explored: a bench with its samples, materials to choose from, and perhaps a visit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.explore.sliders import LEAST_N, SLIDERS
from scenarios.scenario import Protocol, builtin_names, load_scenario, scenario_name
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators import EstimateResult
    from twin.bench import Bench, Sample
    from twin.measurement import RelativeIntensities

MOST_WAVELENGTHS = 31
"""Of a picture: more would cost time and show nothing new."""
GREY = "grey"
ESTIMATE, TRUTH = "the estimate", "the scenario's material"
MEASUREMENT, RESULT = "measurement.nc", "result.nc"
"""Files of an output folder."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A material by wavelength: albedo, sigma_t_per_mm [1/mm] and g, shape (W,) each."""

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray


@dataclass(frozen=True, eq=False)
class Source:
    """Everything that stays while a person moves sliders.

    Attributes:
        title: what is explored.
        bench, samples, protocol: as described.
        wavelength_nm: [nm], shape (W,), of every picture.
        spectra: materials to choose from, the first one is shown first.
        n, rho_black, rho_white: as described, shape (W,).
        measured: the visit's relative intensities at all its wavelengths; None: simulated.
        result: its estimate; None: none was given.
        notes: what was left out or assumed.
        fingerprint: of the measurement, or "".
    """

    title: str
    bench: Bench
    samples: tuple[Sample, ...]
    protocol: Protocol
    wavelength_nm: FloatArray
    spectra: Mapping[str, Spectrum]
    n: FloatArray
    rho_black: FloatArray
    rho_white: FloatArray
    measured: RelativeIntensities | None = None
    result: EstimateResult | None = None
    notes: tuple[str, ...] = ()
    fingerprint: str = ""

    @property
    def middle(self) -> int:
        """Index of the wavelength that is shown first."""
        return int(np.argmin(np.abs(self.wavelength_nm - 550.0)))


def source_of(given: str | None, result: Path | None = None) -> Source:
    """Read what a person names.

    Args:
        given: a built-in scenario, a scenario's file, a measurement (netCDF or folder), or the
            output folder of a run; None takes the default scenario.
        result: a result.nc of this measurement; None takes the output folder's own, if it has one.

    Raises:
        InputError: nothing of the kind, a bench that the fast engine cannot show, or an estimate
            of other samples.
    """
    name = given or "default"
    path = Path(name)
    if name in builtin_names() or path.suffix in (".toml", ".json") or not path.exists():
        if result is not None:
            raise InputError(
                "an estimate with a scenario", "a measurement with --result", place="--result"
            )
        return _of_scenario(name)
    if path.is_dir() and (path / MEASUREMENT).is_file():
        own = path / RESULT
        return _of_measurement(path / MEASUREMENT, result or (own if own.is_file() else None))
    return _of_measurement(path, result)


def _of_scenario(name: str) -> Source:
    from twin.materials import optical_properties

    scenario = load_scenario(name)
    instrument = scenario.bench.instrument
    wavelength = thinned(np.asarray(instrument.wavelength_nm, dtype=np.float64))
    material = scenario.samples[0].material
    if material is None:
        raise InputError("no material", "a scenario with one", file=name, place="samples")
    own = optical_properties(material, wavelength)
    spectrum, notes = _within(Spectrum(own.albedo, own.sigma_t_per_mm, own.g), TRUTH)
    return _source(
        f"{scenario.title} (scenario {scenario_name(name)})", scenario.bench, scenario.samples,
        scenario.protocol, wavelength, {TRUTH: spectrum}, notes,
    )  # fmt: skip


def _of_measurement(path: Path, result: Path | None) -> Source:
    from twin.measurement import read_measurement, relative_intensities

    measurement = read_measurement(path)
    seen = relative_intensities(measurement)
    wavelength = thinned(np.asarray(seen.wavelength_nm))
    estimate, spectra, notes = None, {}, list(seen.reasons)
    if result is not None:
        estimate = _estimate(result, seen)
        at = np.searchsorted(seen.wavelength_nm, wavelength)
        known = np.asarray(np.isfinite(estimate.parameters[at]).all(axis=-1))
        if known.sum() >= 2 or known.all():
            columns = [
                np.interp(wavelength, wavelength[known], column[known])
                for column in estimate.parameters[at].T
            ]
            spectra[ESTIMATE], said = _within(Spectrum(*columns), ESTIMATE)
            notes += said
            if not known.all():
                notes.append(
                    f"the estimate has no value at {np.sum(~known)} of {len(known)} wavelengths:"
                    " the curve is bridged there"
                )
        else:
            notes.append("the estimate has no values to start from")
    name = path.parent.resolve().name if path.name == MEASUREMENT else path.stem
    kind = "a simulated visit" if measurement.provenance.origin == "simulated" else "a visit"
    found = _source(
        f"{name}, {kind}",
        measurement.bench, measurement.samples, Protocol(), wavelength, spectra, tuple(notes),
    )  # fmt: skip
    return replace(found, measured=seen, result=estimate, fingerprint=measurement.fingerprint)


def _estimate(path: Path, seen: RelativeIntensities) -> EstimateResult:
    from estimators import read_netcdf

    found = read_netcdf(path)
    if tuple(found.sample_names) != tuple(seen.sample_names) or not np.array_equal(
        found.wavelength_nm, seen.wavelength_nm
    ):
        raise InputError(
            f"an estimate of {', '.join(found.sample_names)} at {found.wavelength_nm.size}"
            " wavelengths",
            f"one of {', '.join(seen.sample_names)} at {seen.wavelength_nm.size} wavelengths",
            file=path,
            remedy="Estimate this measurement: benchtwin estimate.",
        )
    return found


def _source(
    title: str,
    bench: Bench,
    samples: tuple[Sample, ...],
    protocol: Protocol,
    wavelength: FloatArray,
    spectra: Mapping[str, Spectrum],
    notes: tuple[str, ...],
) -> Source:
    from twin.materials import reflectance, refractive_index

    count = len(wavelength)
    n = refractive_index(samples[0].n, wavelength)
    black = reflectance(bench.background.black.reflectance, wavelength)
    white = reflectance(bench.background.white.reflectance, wavelength)
    if np.any(n < LEAST_N):
        notes = (*notes, f"a refractive index of 1 is drawn as {LEAST_N:g}")
    if any(sample.n != samples[0].n for sample in samples):
        notes = (*notes, f"all samples are drawn with the refractive index of {samples[0].name}")
    notes += _beyond(
        {
            "thickness_mm": np.array([sample.thickness_mm for sample in samples]),
            "n": np.maximum(n, LEAST_N), "rho_black": black, "rho_white": white,
            "acceptance_deg": np.array([bench.detector.acceptance_deg]),
            "averages": np.array([float(bench.instrument.frames)]),
        }
    )  # fmt: skip
    grey = Spectrum(np.full(count, 0.9), np.full(count, 5.0), np.full(count, 0.4))
    return Source(
        title, bench, samples, protocol, wavelength,
        {**spectra, GREY: grey, **library(wavelength)},
        np.maximum(n, LEAST_N), black, white,
        notes=notes,
    )  # fmt: skip


def _beyond(described: Mapping[str, FloatArray]) -> tuple[str, ...]:
    """What of the description a slider cannot stand at: said, because a move goes to its end."""
    return tuple(
        f"{slider.label} is described as {values.min():g} to {values.max():g}, its slider goes from"
        f" {slider.low:g} to {slider.high:g}: from the first move on it is drawn at the end"
        for slider in SLIDERS
        if (values := described.get(slider.name)) is not None
        and (values.min() < slider.low or values.max() > slider.high)
    )


def thinned(wavelength_nm: FloatArray) -> FloatArray:
    """Every k-th wavelength, so that no more than `MOST_WAVELENGTHS` are left."""
    step = -(-len(wavelength_nm) // MOST_WAVELENGTHS)
    return np.asarray(wavelength_nm[::step])


def library(wavelength_nm: FloatArray) -> dict[str, Spectrum]:
    """Materials of the library that scatter, cover the wavelengths and fit the sliders."""
    from twin.materials import names, optical_properties

    found = {}
    for name in sorted(names("material")):
        try:
            own = optical_properties(name, wavelength_nm)
        except InputError:  # it does not reach as far: no material for this page
            continue
        spectrum = Spectrum(own.albedo, own.sigma_t_per_mm, own.g)
        if np.all(own.albedo > 0.0) and not _within(spectrum, name)[1]:
            found[name] = spectrum
    return found


def _within(spectrum: Spectrum, name: str) -> tuple[Spectrum, tuple[str, ...]]:
    """The spectrum inside the sliders' ranges, and what had to be moved there."""
    columns, notes = {}, []
    for slider in SLIDERS[:3]:
        values = getattr(spectrum, slider.name)
        columns[slider.name] = np.clip(values, slider.low, slider.high)
        moved = int(np.sum(columns[slider.name] != values))
        if moved:
            notes.append(
                f"{slider.label} of {name} leaves the slider's range ({slider.low:g} to"
                f" {slider.high:g}) at {moved} of {values.size} wavelengths: drawn at its end there"
            )
    return Spectrum(**columns), tuple(notes)
