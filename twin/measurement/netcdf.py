"""A measurement as one netCDF-4 file: the same measurement gives the same bytes.

Behind the netCDF-4 data, where every reader of netCDF and HDF5 stops, stands one line with the
SHA-256 of what is before it. It is checked before the HDF5 library sees a byte, because that
library can run for minutes on a file with a few damaged bytes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.files import read_sealed_tree, write_sealed_tree
from twin.measurement.model import (
    Captures,
    Measurement,
    Provenance,
    RelativeRow,
    RelativeSpectra,
    Shot,
    Truth,
)
from twin.toml import validate

if TYPE_CHECKING:
    from xarray import Dataset, DataTree

FORMAT = "benchtwin measurement"
FORMAT_VERSION = 1

_SHOT_UNITS = {"integration_s": "s", "averages": "1", "time_s": "s", "gain": "1", "repeat": "1"}
_TRUTH_UNITS = {"albedo": "1", "sigma_t_per_mm": "1/mm", "g": "1"}


def write_measurement(measurement: Measurement, path: str | Path) -> Path:
    """Write a measurement to one netCDF-4 file, atomically; the path is returned.

    Raises:
        InputError: the folder cannot be written.
    """
    return write_sealed_tree(_tree(measurement), Path(path))


def read_netcdf(path: str | Path) -> Measurement:
    """Read a measurement from a netCDF-4 file that `write_measurement` made.

    Raises:
        InputError: no such file, or one that is foreign, truncated or damaged.
    """
    path = Path(path)
    expected = f"a {FORMAT} of version {FORMAT_VERSION}"
    return read_sealed_tree(path, "a measurement", expected, lambda tree: _measurement(tree, path))


def _text(value: str) -> tuple[tuple[()], Any]:
    # A variable, not an attribute: HDF5 holds no attribute above 64 kB, and a bench with a few
    # measured spectra in it is longer.
    return ((), np.array(value, dtype=object))


def _floats(dims: Any, value: Any, units: str, long_name: str = "") -> tuple[Any, Any, Any, Any]:
    attributes = {"units": units} | ({"long_name": long_name} if long_name else {})
    return (dims, np.asarray(value, dtype=np.float64), attributes, {"_FillValue": None})


def _tree(measurement: Measurement) -> DataTree:
    import xarray

    root = xarray.Dataset(
        {
            "bench": _text(measurement.bench.model_dump_json()),
            "provenance": _text(measurement.provenance.model_dump_json()),
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": FORMAT,
            "format_version": FORMAT_VERSION,
            "fingerprint": measurement.fingerprint,
        },
    )
    groups = {"/": root, "/samples": _samples(measurement.samples)}
    if measurement.captures is not None:
        groups["/captures"] = _captures(measurement.captures)
    if measurement.relative is not None:
        groups["/relative"] = _relative(measurement.relative)
    if measurement.truth is not None:
        truth = measurement.truth
        groups["/truth"] = xarray.Dataset(
            {
                name: _floats(("sample", "wavelength"), getattr(truth, name), units)
                for name, units in _TRUTH_UNITS.items()
            },
            coords={"wavelength_nm": _floats("wavelength", truth.wavelength_nm, "nm")},
        )
    return xarray.DataTree.from_dict(groups)


def _strings(values: list[str]) -> Any:
    return np.array(values, dtype=object)


def _samples(samples: tuple[Sample, ...]) -> Dataset:
    import xarray

    return xarray.Dataset(
        {
            "name": ("sample", _strings([sample.name for sample in samples])),
            "thickness_mm": _floats("sample", [s.thickness_mm for s in samples], "mm"),
            "description": (
                "sample",
                _strings([sample.model_dump_json() for sample in samples]),
                {"long_name": "the whole sample as JSON"},
            ),
        }
    )


def _captures(captures: Captures) -> Dataset:
    import xarray

    shots = captures.shots
    variables: dict[str, Any] = {
        "capture": ("shot", _strings([shot.capture for shot in shots])),
        "sample": ("shot", _strings([shot.sample for shot in shots])),
        "counts": _floats(("shot", "wavelength"), captures.counts, "count", "mean over averages"),
        "saturated": (
            ("shot", "wavelength"),
            captures.saturated.astype(np.int8),
            {"units": "1", "flag_values": np.array([0, 1], np.int8), "flag_meanings": "no yes"},
        ),
    }
    if captures.light_se is not None:
        variables["light_se"] = _floats(
            ("own_sample", "relative_capture", "wavelength"),
            captures.light_se,
            "1",
            "standard error of the simulated relative intensities (black, white, collimated)",
        )
    for name, units in _SHOT_UNITS.items():
        values = np.array([getattr(shot, name) for shot in shots])
        if name in ("averages", "repeat"):
            variables[name] = ("shot", values.astype(np.int64), {"units": units})
        else:
            variables[name] = _floats("shot", values, units)
    return xarray.Dataset(
        variables, coords={"wavelength_nm": _floats("wavelength", captures.wavelength_nm, "nm")}
    )


def _relative(relative: RelativeSpectra) -> Dataset:
    import xarray

    rows = relative.rows
    return xarray.Dataset(
        {
            "capture": ("row", _strings([row.capture for row in rows])),
            "sample": ("row", _strings([row.sample for row in rows])),
            "repeat": ("row", np.array([r.repeat for r in rows], np.int64), {"units": "1"}),
            "value": _floats(("row", "wavelength"), relative.value, "1", "relative intensity"),
            "sigma": _floats(("row", "wavelength"), relative.sigma, "1", "standard error of value"),
        },
        coords={"wavelength_nm": _floats("wavelength", relative.wavelength_nm, "nm")},
    )


def _measurement(tree: DataTree, path: Path) -> Measurement:
    title, version = tree.attrs.get("title"), tree.attrs.get("format_version")
    if title != FORMAT:
        raise InputError(f"a file with the title {title!r}", f"the title {FORMAT!r}")
    if version != FORMAT_VERSION:
        raise InputError(
            f"format version {version}",
            f"version {FORMAT_VERSION}",
            remedy="Another version of benchtwin wrote it.",
        )
    samples = [
        validate(json.loads(str(text)), Sample, file=f"{path}: samples")
        for text in np.asarray(tree["samples"]["description"].values)
    ]
    return Measurement(
        bench=validate(json.loads(_scalar(tree, "bench")), Bench, file=f"{path}: bench"),
        samples=tuple(samples),
        provenance=validate(
            json.loads(_scalar(tree, "provenance")), Provenance, file=f"{path}: provenance"
        ),
        captures=_read_captures(tree["captures"]) if "captures" in tree.children else None,
        relative=_read_relative(tree["relative"]) if "relative" in tree.children else None,
        truth=_read_truth(tree["truth"]) if "truth" in tree.children else None,
    )


def _scalar(tree: DataTree, name: str) -> str:
    return str(np.asarray(tree[name].values).item())


def _read_captures(group: Any) -> Captures:
    columns = [group[name].values for name in ("capture", "sample", *_SHOT_UNITS)]
    shots = tuple(
        Shot(
            capture=str(capture),
            sample=str(sample),
            integration_s=float(integration),
            averages=int(averages),
            time_s=float(time),
            gain=float(gain),
            repeat=int(repeat),
        )
        for capture, sample, integration, averages, time, gain, repeat in zip(*columns, strict=True)
    )
    return Captures(
        shots,
        group["wavelength_nm"].values,
        group["counts"].values,
        group["saturated"].values != 0,
        group["light_se"].values if "light_se" in group else None,
    )


def _read_relative(group: Any) -> RelativeSpectra:
    columns = [group[name].values for name in ("sample", "capture", "repeat")]
    rows = tuple(RelativeRow(str(s), str(c), int(r)) for s, c, r in zip(*columns, strict=True))
    return RelativeSpectra(
        rows, group["wavelength_nm"].values, group["value"].values, group["sigma"].values
    )


def _read_truth(group: Any) -> Truth:
    return Truth(group["wavelength_nm"].values, *(group[name].values for name in _TRUTH_UNITS))
