"""A fluorescence visit as one netCDF-4 file with a checksum: the same visit, the same bytes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.errors import InputError
from twin.files import has_title, read_sealed_tree, write_sealed_tree
from twin.fluorescence.donaldson import DonaldsonMatrix
from twin.fluorescence.setup import FluorescenceSetup
from twin.fluorescence.visit import FluorescenceShot, FluorescenceVisit
from twin.measurement import Provenance
from twin.toml import validate

if TYPE_CHECKING:
    from xarray import DataTree

FORMAT = "benchtwin fluorescence visit"
FORMAT_VERSION = 1

_FLOATS = {"integration_s": "s", "time_s": "s", "gain": "1"}
_INTEGERS = ("repeat", "averages")
_WORDS = ("kind", "illuminant")


def write_visit(visit: FluorescenceVisit, path: str | Path) -> Path:
    """Write a visit to one netCDF-4 file, atomically; the path is returned.

    Raises:
        InputError: the folder cannot be written.
    """
    return write_sealed_tree(_tree(visit), Path(path))


def read_visit(path: str | Path) -> FluorescenceVisit:
    """Read a visit: a netCDF-4 file of `write_visit`, or a folder made by hand.

    Raises:
        InputError: no such file, or one that is foreign, truncated or damaged.
    """
    path = Path(path)
    if path.is_dir():
        from twin.fluorescence.visit_folder import read_visit_folder

        return read_visit_folder(path)
    expected = f"a {FORMAT} of version {FORMAT_VERSION}"
    return read_sealed_tree(path, "a fluorescence visit", expected, lambda tree: _visit(tree, path))


def is_fluorescence_visit(path: str | Path) -> bool:
    """Whether a path holds a fluorescence visit: its folder's visit.toml or its file's title."""
    path = Path(path)
    if path.is_dir():
        return (path / "visit.toml").is_file()
    return has_title(path, FORMAT)


def _text(value: str) -> tuple[tuple[()], Any]:
    return ((), np.array(value, dtype=object))


def _floats(dims: Any, value: Any, units: str) -> tuple[Any, Any, Any, Any]:
    return (dims, np.asarray(value, dtype=np.float64), {"units": units}, {"_FillValue": None})


def _tree(visit: FluorescenceVisit) -> DataTree:
    import xarray

    root = xarray.Dataset(
        {
            "setup": _text(visit.setup.model_dump_json()),
            "provenance": _text(visit.provenance.model_dump_json()),
            "sample": _text(visit.sample),
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": FORMAT,
            "format_version": FORMAT_VERSION,
            "fingerprint": visit.fingerprint,
        },
    )
    shots = visit.shots
    variables: dict[str, Any] = {
        "counts": _floats(("shot", "channel"), visit.counts, "count"),
        "saturated": (
            ("shot", "channel"),
            visit.saturated.astype(np.int8),
            {"units": "1", "flag_values": np.array([0, 1], np.int8), "flag_meanings": "no yes"},
        ),
    }
    for name in _WORDS:
        words = np.array([getattr(shot, name) for shot in shots], dtype=object)
        variables[name] = ("shot", words)
    for name in _INTEGERS:
        numbers = np.array([getattr(shot, name) for shot in shots], dtype=np.int64)
        variables[name] = ("shot", numbers, {"units": "1"})
    for name, units in _FLOATS.items():
        variables[name] = _floats("shot", [getattr(shot, name) for shot in shots], units)
    groups = {
        "/": root,
        "/captures": xarray.Dataset(
            variables,
            coords={"wavelength_nm": _floats("channel", visit.setup.detector.wavelength_nm, "nm")},
        ),
    }
    if visit.truth is not None:
        truth = visit.truth
        groups["/truth"] = xarray.Dataset(
            {
                "matrix": _floats(("emission", "excitation"), truth.matrix, "1"),
                "emission_nm": _floats("emission", truth.emission_nm, "nm"),
                "excitation_nm": _floats("excitation", truth.excitation_nm, "nm"),
                "about": _text(json.dumps([truth.name, truth.source, list(truth.notes)])),
            }
        )
    return xarray.DataTree.from_dict(groups)


def _scalar(group: Any, name: str) -> str:
    return str(np.asarray(group[name].values).item())


def _visit(tree: DataTree, path: Path) -> FluorescenceVisit:
    title, version = tree.attrs.get("title"), tree.attrs.get("format_version")
    if title != FORMAT:
        raise InputError(f"a file with the title {title!r}", f"the title {FORMAT!r}")
    if version != FORMAT_VERSION:
        raise InputError(
            f"format version {version}", f"version {FORMAT_VERSION}",
            remedy="Another version of benchtwin wrote it.",
        )  # fmt: skip
    group: Any = tree["captures"]
    held_columns = [group[name].values for name in (*_WORDS, *_INTEGERS, *_FLOATS)]
    shots = tuple(
        FluorescenceShot(
            kind=str(kind), illuminant=str(illuminant), repeat=int(repeat),
            averages=int(averages), integration_s=float(integration), time_s=float(time),
            gain=float(gain),
        )
        for kind, illuminant, repeat, averages, integration, time, gain in zip(
            *held_columns, strict=True
        )
    )  # fmt: skip
    truth = None
    if "truth" in tree.children:
        held: Any = tree["truth"]
        name, source, notes = json.loads(_scalar(held, "about"))
        truth = DonaldsonMatrix(
            held["matrix"].values, held["emission_nm"].values, held["excitation_nm"].values,
            name=name, source=source, notes=tuple(notes),
        )  # fmt: skip
    return FluorescenceVisit(
        validate(json.loads(_scalar(tree, "setup")), FluorescenceSetup, file=f"{path}: setup"),
        shots,
        group["counts"].values,
        group["saturated"].values != 0,
        sample=_scalar(tree, "sample"),
        provenance=validate(
            json.loads(_scalar(tree, "provenance")), Provenance, file=f"{path}: provenance"
        ),
        truth=truth,
    )
