"""An estimate of a Donaldson matrix as one netCDF-4 file with a checksum, and as a table of cells.

Same estimate, same bytes. The file ends, behind the netCDF-4 data where its readers stop, with the
SHA-256 of what is before.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.fluorescence.result import FluorescenceResult, FluorescenceStatus
from twin.files import has_title, read_sealed_tree, write_atomically, write_sealed_tree

if TYPE_CHECKING:
    from xarray import DataTree

FORMAT = "benchtwin fluorescence estimate"
FORMAT_VERSION = 1
CSV_HEADER = (
    "emission_nm,excitation_nm,value,standard_deviation,lower_90,median,upper_90,undetermined"
)
_CELLS = ("emission", "excitation")
_FLOATS: dict[str, tuple[tuple[str, ...], str]] = {
    "matrix": (_CELLS, "energy per emission bin over energy per excitation bin"),
    "standard_deviation": (_CELLS, "of every cell"),
    "quantile": (("level", *_CELLS), "of every cell"),
    "residual": (("illuminant", "channel"), "predicted minus captured"),
    "residual_normalised": (("illuminant", "channel"), "in standard deviations"),
}
_OPTIONAL: dict[str, tuple[tuple[str, ...], str]] = {
    "draws": (("draw", *_CELLS), "posterior draws of the matrix"),
    "mixture_draws": (
        ("mixture_draw", "gaussian", "number"),
        "draws of weight [nm^2], means [nm] and variances [nm^2] of excitation and emission",
    ),
    "moment_draws": (("moment_draw", "moment"), "draws of the moments of the diagonal"),
}
_COORDINATES = {"emission_nm": "emission", "excitation_nm": "excitation", "quantile_level": "level"}


def write_result(result: FluorescenceResult, path: str | Path) -> Path:
    """Write one netCDF-4 file, atomically; the path is returned.

    Raises:
        InputError: the folder cannot be written.
    """
    return write_sealed_tree(_tree(result), Path(path))


def read_result(path: str | Path) -> FluorescenceResult:
    """Read an estimate that `write_result` wrote.

    Raises:
        InputError: no such file, or one that is foreign, truncated or damaged.
    """
    path = Path(path)

    def made(tree: DataTree) -> FluorescenceResult:
        if tree.attrs["title"] != FORMAT or tree.attrs["format_version"] != FORMAT_VERSION:
            raise ValueError("another title or version")
        return _result(tree)

    expected = f"a {FORMAT} of version {FORMAT_VERSION}"
    return read_sealed_tree(path, f"a {FORMAT}", expected, made)


def is_fluorescence_result(path: str | Path) -> bool:
    """Whether a path is a file that `write_result` wrote, by its title."""
    return has_title(Path(path), FORMAT)


def write_cells_csv(result: FluorescenceResult, path: str | Path) -> Path:
    """Write one row per cell on or above the excitation, atomically; the path is returned.

    An unknown number is an empty cell.

    Raises:
        InputError: the folder cannot be written.
    """
    rows = [CSV_HEADER]
    level = list(result.quantile_level)
    order = [level.index(each) for each in (level[0], level[len(level) // 2], level[-1])]
    for o, emission in enumerate(result.emission_nm):
        for i, excitation in enumerate(result.excitation_nm):
            if emission < excitation - 1e-6:
                continue
            numbers = (
                emission, excitation, result.matrix[o, i], result.standard_deviation[o, i],
                *(result.quantile[q, o, i] for q in order),
            )  # fmt: skip
            text = ",".join(f"{x:.10g}" if np.isfinite(x) else "" for x in map(float, numbers))
            rows.append(f"{text},{str(bool(result.undetermined[o, i])).lower()}")
    return write_atomically(Path(path), ("\n".join(rows) + "\n").encode())


def _array(dims: Any, value: Any, long_name: str, units: str = "1") -> tuple[Any, Any, Any, Any]:
    attributes = {"units": units, "long_name": long_name}
    return (dims, np.asarray(value, dtype=np.float64), attributes, {"_FillValue": None})


def _tree(result: FluorescenceResult) -> DataTree:
    import xarray

    variables: dict[str, Any] = {
        name: _array(dims, getattr(result, name), text) for name, (dims, text) in _FLOATS.items()
    }
    for name, (dims, text) in _OPTIONAL.items():
        value = getattr(result, name)
        if value is not None:
            variables[name] = _array(dims, value, text)
    variables["undetermined"] = (
        _CELLS,
        result.undetermined.astype(np.int8),
        {"units": "1", "flag_values": np.array([0, 1], np.int8), "flag_meanings": "no yes"},
    )
    coordinates = {
        name: _array(dim, getattr(result, name), name.replace("_", " ").removesuffix(" nm"),
                     "nm" if name.endswith("_nm") else "1")
        for name, dim in _COORDINATES.items()
    }  # fmt: skip
    mixture = result.mixture
    root = xarray.Dataset(
        variables,
        coords=coordinates,
        attrs={
            "Conventions": "CF-1.11",
            "title": FORMAT,
            "format_version": FORMAT_VERSION,
            "estimator": result.estimator,
            "sample": result.sample,
            "status": result.status.name.lower(),
            "fingerprint": result.fingerprint,
            "settings": json.dumps(dict(result.settings), sort_keys=True),
            "messages": json.dumps(list(result.messages)),
            "statistics": json.dumps(dict(result.statistics), sort_keys=True),
            "mixture": "" if mixture is None else mixture.model_dump_json(),
        },
    )
    return xarray.DataTree.from_dict({"/": root})


def _result(tree: DataTree) -> FluorescenceResult:
    from twin.fluorescence.mixture import MixtureModel

    found, told = tree.dataset, tree.attrs
    arrays = {
        name: np.array(found[name].values, dtype=np.float64)
        for name in (*_FLOATS, *_COORDINATES, *_OPTIONAL)
        if name in found.variables
    }
    mixture = MixtureModel.model_validate_json(told["mixture"]) if told["mixture"] else None
    return FluorescenceResult(
        estimator=str(told["estimator"]),
        sample=str(told["sample"]),
        status=FluorescenceStatus[str(told["status"]).upper()],
        undetermined=found["undetermined"].values != 0,
        settings=json.loads(told["settings"]),
        fingerprint=str(told["fingerprint"]),
        messages=tuple(json.loads(told["messages"])),
        statistics=json.loads(told["statistics"]),
        mixture=mixture,
        **arrays,
    )
