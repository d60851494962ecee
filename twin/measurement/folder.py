"""A measurement that a person makes with a text editor and a spreadsheet: a folder.

    bench.toml      the bench; may be missing, every key has a default
    samples.csv     the samples
    captures.csv    raw counts, one row per shot and wavelength;  or
    relative.csv    relative intensities, one row per spectrum and wavelength;  or
    files.toml      how the names of exported spectra (OceanView, JCAMP-DX) beside it are made

A folder that `write_folder` wrote also has origin.toml, and truth.csv and light_se.csv of a
simulated visit; in place of samples.csv there may be samples.toml. Every column, its unit and its
default: docs/measurement.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.instrument import MultispectralChip, Spectrometer, saturation_counts
from twin.measurement.file_names import FILE
from twin.measurement.model import (
    CAPTURES,
    SAMPLE_CAPTURES,
    Captures,
    Measurement,
    Provenance,
    RelativeRow,
    RelativeSpectra,
    Shot,
    check_shot,
    label,
)
from twin.measurement.named_files import read_named_files
from twin.measurement.relative import relative_intensities
from twin.measurement.table import Column, Row, read_table
from twin.measurement.written import (
    SAMPLES_TOML,
    SamplesFile,
    read_light_se,
    read_truth,
    with_origin,
)
from twin.spectra import FloatArray
from twin.toml import load_toml, near_misses, parse_table, read_text, validate

SAMPLE_COLUMNS = (
    Column("name", "text", required=True),
    Column("thickness_mm", "number", required=True),
    Column("n", "text", default=None),
    Column("material", "text", default=None),
)
CAPTURE_COLUMNS = (
    Column("capture", "text", required=True),
    Column("sample", "text", default=""),
    Column("repeat", "whole", default=0),
    Column("wavelength_nm", "number", required=True),
    Column("counts", "reading", required=True),
    Column("integration_s", "number", required=True),
    Column("averages", "whole", default=1),
    Column("gain", "number", default=None),
    Column("time_s", "number", default=0.0),
    Column("saturated", "whole", default=None),
)
RELATIVE_COLUMNS = (
    Column("capture", "text", required=True),
    Column("sample", "text", required=True),
    Column("repeat", "whole", default=0),
    Column("wavelength_nm", "number", required=True),
    Column("value", "reading", required=True),
    Column("sigma", "number", default=None),
)
PER_CENT = 5.0
"""No relative intensity comes near this: a spectrum whose median does is in per cent."""

_DATA = ("captures.csv", "relative.csv", FILE)
_FILES = ("bench.toml", "samples.csv", SAMPLES_TOML, *_DATA)


def read_folder(path: str | Path) -> Measurement:
    """Read a hand-made folder and check that relative intensities follow from it.

    Raises:
        InputError: what is wrong, with file, line, column, found and expected.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError("no such folder", "a folder", file=folder)
    bench, described = _bench(folder)
    path, samples, places = _samples(folder)
    there = [folder / name for name in _DATA if (folder / name).exists()]
    if len(there) > 1:
        raise InputError(
            " and ".join(each.name for each in there), "one of them", file=folder,
            remedy="Remove the other.",
        )  # fmt: skip
    if not there:
        raise _missing(folder, "captures.csv", f"captures.csv, relative.csv or {FILE}")
    chosen = there[0]
    known = [sample.name for sample in samples]
    captures, relative = None, None
    notes: list[str] = []
    try:
        if chosen.name == FILE:
            captures, notes = read_named_files(folder, known, bench, described=described)
        elif chosen.name == "captures.csv":
            captures, notes = _captures(chosen, known, bench)
        else:
            relative = _relative(chosen, known)
        spectra = captures if captures is not None else relative
        wavelength = spectra.wavelength_nm if spectra is not None else np.empty(0)
        bench = _with_grid(bench, described, wavelength, chosen.name)
        _check_library_names(samples, places, wavelength, path)
        _check_spectra(bench, folder / "bench.toml")
        if captures is not None:
            captures = replace(captures, light_se=read_light_se(folder, known, wavelength))
        measurement = Measurement(
            bench=bench,
            samples=samples,
            captures=captures,
            relative=relative,
            provenance=Provenance(
                origin="handmade",
                noise="instrument" if described else "repeats",
                notes=tuple(notes),
            ),
            truth=read_truth(folder, known),
        )
        measurement = with_origin(folder, measurement)
        relative_intensities(measurement)
    except InputError as error:
        if error.file:
            raise
        raise error.at(chosen) from error
    return measurement


def _missing(folder: Path, name: str, expected: str) -> InputError:
    there = sorted(entry.name for entry in folder.iterdir())
    remedy = near_misses(name, [entry for entry in there if entry not in _FILES])
    if "measurement.nc" in there:
        remedy = f"A simulated visit is one file: name {folder / 'measurement.nc'}."
    return InputError(f"no {name}", expected, file=folder, remedy=remedy)


def _bench(folder: Path) -> tuple[Bench, bool]:
    """The bench, and whether somebody described its instrument."""
    path = folder / "bench.toml"
    if not path.exists():
        near = [e.name for e in sorted(folder.iterdir()) if e.suffix == ".toml"]
        if near:
            raise InputError(f"{', '.join(near)}", "bench.toml, or no TOML file", file=folder)
        return Bench(), False
    table = parse_table(read_text(path), file=path)
    if "instrument" in table and isinstance(table["instrument"], dict):
        table["instrument"].setdefault("kind", "spectrometer")
    return validate(table, Bench, file=path), "instrument" in table


def _samples(folder: Path) -> tuple[Path, tuple[Sample, ...], list[str]]:
    """The file of the samples, the samples, and the place of each in messages."""
    path, full = folder / "samples.csv", folder / SAMPLES_TOML
    if path.exists() and full.exists():
        raise InputError(
            f"{path.name} and {full.name}", "one of them", file=folder, remedy="Remove the other."
        )
    if full.exists():
        found = load_toml(full, SamplesFile).samples
        _each_once([sample.name for sample in found], full)
        return full, found, [f"samples[{index}]." for index in range(len(found))]
    if not path.exists():
        raise _missing(folder, "samples.csv", "a table with name and thickness_mm")
    samples: dict[str, Sample] = {}
    places: list[str] = []
    for row in read_table(path, SAMPLE_COLUMNS):
        place = f"line {row.line}, column "
        given: dict[str, Any] = {k: v for k, v in row.values.items() if v is not None}
        name, thickness = given["name"], given["thickness_mm"]
        if name in samples:
            raise InputError(f"{name!r} twice", "every name once", file=path, place=place + "name")
        if thickness <= 0:
            raise InputError(
                f"{thickness:g}",
                "a thickness above 0 [mm]",
                file=path,
                place=place + "thickness_mm",
            )
        if "n" in given:
            given["n"] = _index(given["n"], path, place + "n")
        try:
            samples[name] = validate(given, Sample)
        except InputError as error:
            raise error.at(path, f"line {row.line}, column {error.place}") from error
        places.append(place)
    return path, tuple(samples.values()), places


def _each_once(names: list[str], path: Path) -> None:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise InputError(
                f"{name!r} twice", "every name once", file=path, place=f"samples[{index}].name"
            )
    if not names:
        raise InputError("no sample", "one or more", file=path, place="samples")


def _index(text: str, path: Path, place: str) -> float | str:
    try:
        value = float(text)
    except ValueError:
        if text.replace(",", "", 1).isdigit():
            raise InputError(
                f"{text!r}",
                "a number like 1.5, or a name",
                file=path,
                place=place,
                remedy="Write numbers with a decimal point, not a decimal comma.",
            ) from None
        return text
    if not 1.0 <= value <= 5.0:
        raise InputError(f"{value:g}", "a refractive index of 1 to 5", file=path, place=place)
    return value


def _check_library_names(
    samples: tuple[Sample, ...], places: list[str], wavelength_nm: FloatArray, path: Path
) -> None:
    from twin.materials import material, refractive_index

    for sample, place in zip(samples, places, strict=True):
        if isinstance(sample.material, str):
            try:
                material(sample.material)
            except InputError as error:
                raise error.at(path, f"{place}material") from error
        if isinstance(sample.n, str):
            try:
                refractive_index(sample.n, wavelength_nm)
            except InputError as error:
                raise error.at(path, f"{place}n") from error


def _check_spectra(bench: Bench, path: Path) -> None:
    """Names and reflectances of bench.toml; whether they cover the wavelengths is seen later."""
    from twin.materials import names

    white, black = bench.background.white.reflectance, bench.background.black.reflectance
    for value, place, dark, expected in (
        (white, "background.white.reflectance", False, "a reflectance above 0, up to 1"),
        (black, "background.black.reflectance", True, "a reflectance of 0 to 1"),
    ):
        if isinstance(value, str) and value not in names("reflectance"):
            raise InputError(
                f"the reflectance {value!r}",
                f"a number, a table, or one of {', '.join(names('reflectance'))}",
                file=path,
                place=place,
                remedy=near_misses(value, names("reflectance")),
            )
        if isinstance(value, float) and not (0 < value <= 1 or (dark and value == 0)):
            remedy = "Divide a value in per cent by 100." if value > 1 else ""
            raise InputError(f"{value:g}", expected, file=path, place=place, remedy=remedy)
    for place, lamp_name in (
        ("panel_spectrum", bench.panel_spectrum),
        ("beam.spectrum", bench.beam.spectrum),
    ):
        if isinstance(lamp_name, str) and lamp_name not in names("lamp"):
            raise InputError(
                f"the lamp {lamp_name!r}",
                "a lamp of the library (benchtwin list lamps), a table or a number",
                file=path,
                place=place,
                remedy=near_misses(lamp_name, names("lamp")),
            )


@dataclass
class _Spectrum:
    """The rows of one spectrum while they are collected."""

    line: int
    settings: tuple[Any, ...]
    wavelength: list[float] = field(default_factory=list)
    columns: list[tuple[Any, ...]] = field(default_factory=list)

    def add(self, path: Path, row: Row, settings: tuple[Any, ...], values: tuple[Any, ...]) -> None:
        wavelength = row.values["wavelength_nm"]
        place = f"line {row.line}, column wavelength_nm"
        if settings != self.settings:
            raise InputError(
                f"other settings than in line {self.line}",
                "the same averages and time_s in all rows of a shot",
                file=path,
                place=f"line {row.line}",
            )
        if wavelength in self.wavelength[-1:]:
            raise InputError(
                f"{wavelength:g} nm a second time",
                "every wavelength once in a spectrum",
                file=path,
                place=place,
                remedy="Number repeated readings 0, 1, 2 ... in the column repeat.",
            )
        if self.wavelength and wavelength < self.wavelength[-1]:
            if wavelength in self.wavelength:
                raise InputError(
                    f"{wavelength:g} nm a second time (the spectrum begins in line {self.line})",
                    "every wavelength once in a spectrum",
                    file=path,
                    place=place,
                    remedy="Number repeated readings 0, 1, 2 ... in the column repeat.",
                )
            raise InputError(
                f"{wavelength:g} nm after {self.wavelength[-1]:g} nm",
                "wavelengths that increase",
                file=path,
                place=place,
            )
        self.wavelength.append(wavelength)
        self.columns.append(values)


def _same_grid(path: Path, spectra: list[tuple[str, _Spectrum]]) -> FloatArray:
    """The wavelengths [nm] of all spectra, which must be the same."""
    name, first = spectra[0]
    for other_name, other in spectra[1:]:
        if other.wavelength == first.wavelength:
            continue
        if other.wavelength[0] > first.wavelength[-1] or other.wavelength[-1] < first.wavelength[0]:
            how = ", which do not overlap"
        else:
            how = ""
        remedy = "Is the file truncated?" if len(other.wavelength) < len(first.wavelength) else ""
        raise InputError(
            f"{_grid(other)} in {other_name}{how}",
            f"the wavelengths of {name} (line {first.line}): {_grid(first)}",
            file=path,
            place=f"line {other.line}",
            remedy=remedy,
        )
    return np.array(first.wavelength)


def _grid(spectrum: _Spectrum) -> str:
    wavelength = spectrum.wavelength
    return f"{len(wavelength)} wavelengths from {wavelength[0]:g} to {wavelength[-1]:g} nm"


def _check_names(path: Path, row: Row, known: list[str], captures: tuple[str, ...]) -> None:
    capture, sample = row.values["capture"], row.values["sample"]
    if capture not in captures:
        raise InputError(
            f"{capture!r}",
            f"one of {', '.join(captures)}",
            file=path,
            place=f"line {row.line}, column capture",
            remedy=near_misses(capture, list(captures)),
        )
    if sample and sample not in known:
        raise InputError(
            f"{sample!r}",
            f"a name from samples.csv: {', '.join(known)}",
            file=path,
            place=f"line {row.line}, column sample",
            remedy=near_misses(sample, known),
        )


def _captures(path: Path, known: list[str], bench: Bench) -> tuple[Captures, list[str]]:
    instrument = bench.instrument
    gain = instrument.gain if isinstance(instrument, MultispectralChip) else 1.0
    full = saturation_counts(instrument)
    shots: dict[tuple[Any, ...], tuple[Shot, _Spectrum]] = {}
    for row in read_table(path, CAPTURE_COLUMNS):
        _check_names(path, row, known, CAPTURES)
        v = row.values
        shot = Shot(
            capture=v["capture"],
            integration_s=v["integration_s"],
            sample=v["sample"],
            repeat=v["repeat"],
            averages=v["averages"],
            time_s=v["time_s"],
            gain=gain if v["gain"] is None else v["gain"],
        )
        key = (shot.capture, shot.sample, shot.repeat, shot.integration_s, shot.gain)
        settings = (shot.averages, shot.time_s)
        if key not in shots:
            try:
                check_shot(shot, f"line {row.line}")
            except InputError as error:
                raise error.at(path) from error
            shots[key] = (shot, _Spectrum(row.line, settings))
        flag = v["saturated"]
        if flag not in (None, 0, 1):
            raise InputError(
                f"{flag}", "0 or 1", file=path, place=f"line {row.line}, column saturated"
            )
        saturated = v["counts"] >= full if flag is None else bool(flag)
        shots[key][1].add(path, row, settings, (v["counts"], saturated))
    spectra = [
        (f"{label(shot.capture, shot.sample)}, repeat {shot.repeat}", spectrum)
        for shot, spectrum in shots.values()
    ]
    wavelength = _same_grid(path, spectra)
    table = np.array([spectrum.columns for _, spectrum in spectra], dtype=np.float64)
    captures = Captures(
        tuple(shot for shot, _ in shots.values()), wavelength, table[:, :, 0], table[:, :, 1] != 0
    )
    notes = [f"counts of {full:g} and more taken as saturated"] if captures.saturated.any() else []
    return captures, notes


def _relative(path: Path, known: list[str]) -> RelativeSpectra:
    spectra: dict[RelativeRow, _Spectrum] = {}
    for row in read_table(path, RELATIVE_COLUMNS):
        _check_names(path, row, known, SAMPLE_CAPTURES)
        v = row.values
        key = RelativeRow(v["sample"], v["capture"], v["repeat"])
        spectrum = spectra.setdefault(key, _Spectrum(row.line, ()))
        sigma = v["sigma"]
        if sigma is not None and sigma <= 0:
            raise InputError(
                f"{sigma:g}",
                "a standard error above 0, or an empty cell",
                file=path,
                place=f"line {row.line}, column sigma",
            )
        spectrum.add(path, row, (), (v["value"], np.nan if sigma is None else sigma))
    named = [(f"{label(k.capture, k.sample)}, repeat {k.repeat}", s) for k, s in spectra.items()]
    wavelength = _same_grid(path, named)
    table = np.array([spectrum.columns for _, spectrum in named], dtype=np.float64)
    for (name, spectrum), values in zip(named, table[:, :, 0], strict=True):
        if np.median(np.abs(values)) > PER_CENT:
            raise InputError(
                f"values around {np.median(values):g} in {name}",
                "fractions of a perfect white or of the beam, about 0 to 1",
                file=path,
                place=f"line {spectrum.line}, column value",
                remedy="Divide values in per cent by 100.",
            )
    return RelativeSpectra(tuple(spectra), wavelength, table[:, :, 0], table[:, :, 1])


def _with_grid(bench: Bench, described: bool, wavelength_nm: FloatArray, name: str) -> Bench:
    """The bench with an instrument that has the pixels of the data."""
    instrument = bench.instrument
    grid = tuple(float(value) for value in wavelength_nm)
    stated = instrument.model_fields_set & {"pixels_nm", "start_nm", "stop_nm", "step_nm"}
    if isinstance(instrument, Spectrometer) and not (described and stated):
        return bench.model_copy(
            update={"instrument": instrument.model_copy(update={"pixels_nm": grid})}
        )
    expected = np.asarray(instrument.wavelength_nm)
    if expected.shape != wavelength_nm.shape or not np.allclose(expected, wavelength_nm, rtol=1e-6):
        raise InputError(
            f"{len(grid)} wavelengths from {grid[0]:g} to {grid[-1]:g} nm",
            f"those of the instrument in bench.toml: {len(expected)} from {expected[0]:g} to"
            f" {expected[-1]:g} nm",
            place="wavelength_nm",
        )
    return bench
