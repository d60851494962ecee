"""An estimate as a DataTree, as one netCDF-4 file and as a tidy CSV table.

The file ends, behind the netCDF-4 data where its readers stop, with the SHA-256 of what is
before, which is checked before the HDF5 library sees a byte. Same estimate, same bytes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.result import CAPTURES, PARAMETERS, EstimateResult, Status
from twin.files import read_sealed_tree, write_atomically, write_sealed_tree

if TYPE_CHECKING:
    from xarray import Dataset, DataTree

FORMAT = "benchtwin estimate"
FORMAT_VERSION = 1
CSV_HEADER = (
    "wavelength_nm,sample,quantity,value,standard_error,lower_90,upper_90,identifiable,status"
)
_UNITS = {"albedo": "1", "sigma_t_per_mm": "1/mm", "g": "1"}
_FLAGS = {
    "flag_values": np.array([int(status) for status in Status], dtype=np.int8),
    "flag_meanings": " ".join(status.name.lower() for status in Status),
}


def to_datatree(result: EstimateResult) -> DataTree:
    """The estimate by wavelength at the root, what each sample says alone in /samples."""
    import xarray

    def floats(dims: Any, value: Any, units: str, long_name: str) -> tuple[Any, Any, Any, Any]:
        attributes = {"units": units, "long_name": long_name}
        return (dims, np.asarray(value, dtype=np.float64), attributes, {"_FillValue": None})

    names = ("parameter", np.array(PARAMETERS, dtype=object))
    root = xarray.Dataset(
        {
            **{
                name: floats("wavelength", getattr(result, name), unit, name.split("_per")[0])
                for name, unit in _UNITS.items()
            },
            "covariance": floats(
                ("wavelength", "parameter", "parameter_2"),
                result.covariance,
                "1, 1/mm, 1 multiplied",
                "covariance of albedo, sigma_t and g",
            ),
            "quantile": floats(
                ("level", "wavelength", "parameter"),
                result.quantile,
                "1, 1/mm, 1",
                "quantiles of albedo, sigma_t and g",
            ),
            "identifiable": (("wavelength", "parameter"), result.identifiable.astype(np.int8)),
            "status": ("wavelength", result.status, _FLAGS),
            **(
                {}
                if result.draws is None
                else {
                    "draws": floats(
                        ("draw", "wavelength", "parameter"),
                        result.draws,
                        "1, 1/mm, 1",
                        "posterior draws of albedo, sigma_t and g",
                    )
                }
            ),
        },
        coords={
            "wavelength_nm": floats("wavelength", result.wavelength_nm, "nm", "wavelength"),
            "level": floats("level", result.quantile_level, "1", "level of the quantile"),
            "parameter": names,
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": FORMAT,
            "format_version": FORMAT_VERSION,
            "estimator": result.estimator,
            "fingerprint": result.fingerprint,
            "settings": json.dumps(dict(result.settings), sort_keys=True),
            "messages": json.dumps(list(result.messages)),
        },
    )
    by_capture = ("sample", "capture", "wavelength")
    by_sample = ("sample", "wavelength")
    samples = xarray.Dataset(
        {
            "name": ("sample", np.array(result.sample_names, dtype=object)),
            "thickness_mm": floats("sample", result.thickness_mm, "mm", "thickness"),
            "estimate": floats(
                ("sample", "wavelength", "parameter"),
                result.sample_estimate,
                "1, 1/mm, 1",
                "albedo, sigma_t and g from one sample alone",
            ),
            "sample_status": (by_sample, result.sample_status, _FLAGS),
            "distance": floats(by_sample, result.distance, "1", "distance to the appearance map"),
            "residual": floats(by_capture, result.residual, "1", "predicted minus measured"),
            "residual_normalised": floats(
                by_capture, result.residual_normalised, "1", "in standard deviations"
            ),
            "beer_sigma_t_per_mm": floats(
                by_sample, result.beer_sigma_t_per_mm, "1/mm", "sigma_t by Beer's law"
            ),
            "beer_standard_error_per_mm": floats(
                by_sample, result.beer_standard_error_per_mm, "1/mm", "its standard error"
            ),
        },
        coords={"capture": ("capture", np.array(CAPTURES, dtype=object))},
    )
    groups = {"/": root, "/samples": samples}
    if result.statistics:
        groups["/statistics"] = xarray.Dataset(
            {
                name: floats("wavelength", value, "1", name.replace("_", " "))
                for name, value in sorted(result.statistics.items())
            }
        )
    return xarray.DataTree.from_dict(groups)


def write_netcdf(result: EstimateResult, path: str | Path) -> Path:
    """Write one netCDF-4 file, atomically; the path is returned.

    Raises:
        InputError: the folder cannot be written.
    """
    return write_sealed_tree(to_datatree(result), Path(path))


def read_netcdf(path: str | Path) -> EstimateResult:
    """Read an estimate that `write_netcdf` wrote.

    Raises:
        InputError: no such file, or one that is foreign, truncated or damaged.
    """
    path = Path(path)

    def made(tree: DataTree) -> EstimateResult:
        if tree.attrs["title"] != FORMAT or tree.attrs["format_version"] != FORMAT_VERSION:
            raise ValueError("another title or version")
        found = {name: child.dataset for name, child in tree.children.items()}
        return _result(tree.dataset, found["samples"], found.get("statistics"), dict(tree.attrs))

    expected = f"a {FORMAT} of version {FORMAT_VERSION}"
    return read_sealed_tree(path, f"a {FORMAT}", expected, made)


def write_csv(result: EstimateResult, path: str | Path) -> Path:
    """Write one row per wavelength, sample and quantity, atomically; the path is returned.

    The sample is empty for the estimate from all samples together; an unknown value is an
    empty cell.

    Raises:
        InputError: the folder cannot be written.
    """
    rows = [CSV_HEADER]
    low, high = result.interval(0.90)
    error = result.standard_error
    for w, wavelength in enumerate(result.wavelength_nm):
        status = Status(result.status[w]).name.lower()
        for p, name in enumerate(PARAMETERS):
            numbers = (result.parameters[w, p], error[w, p], low[w, p], high[w, p])
            known = str(bool(result.identifiable[w, p])).lower()
            rows.append(_row(wavelength, "", name, numbers, known, status))
        for s, sample in enumerate(result.sample_names):
            alone = Status(result.sample_status[s, w]).name.lower()
            for p, name in enumerate(PARAMETERS):
                numbers = (result.sample_estimate[s, w, p], np.nan, np.nan, np.nan)
                rows.append(_row(wavelength, sample, name, numbers, "", alone))
            beer = (
                result.beer_sigma_t_per_mm[s, w],
                result.beer_standard_error_per_mm[s, w],
                np.nan,
                np.nan,
            )
            rows.append(_row(wavelength, sample, "beer_sigma_t_per_mm", beer, "", alone))
            away = (result.distance[s, w], np.nan, np.nan, np.nan)
            rows.append(_row(wavelength, sample, "distance", away, "", alone))
            for c, capture in enumerate(CAPTURES):
                rest = (result.residual[s, c, w], np.nan, np.nan, np.nan)
                rows.append(_row(wavelength, sample, f"residual_{capture}", rest, "", alone))
    text = "\n".join(rows) + "\n"
    return write_atomically(Path(path), text.encode())


def _row(wavelength: float, sample: str, name: str, numbers: Any, known: str, status: str) -> str:
    quoted = f'"{sample.replace(chr(34), chr(34) * 2)}"' if set(sample) & set(',"\n\r') else sample
    cells = ["" if not np.isfinite(number) else repr(float(number)) for number in numbers]
    return ",".join([repr(float(wavelength)), quoted, name, *cells, known, status])


def _result(
    root: Dataset, samples: Dataset, statistics: Dataset | None, attributes: Any
) -> EstimateResult:
    def array(data: Dataset, name: str) -> Any:
        return np.array(data[name].values)

    return EstimateResult(
        estimator=str(attributes["estimator"]),
        fingerprint=str(attributes["fingerprint"]),
        settings=json.loads(attributes["settings"]),
        messages=tuple(json.loads(attributes["messages"])),
        quantile_level=array(root, "level"),
        identifiable=array(root, "identifiable").astype(bool),
        sample_names=tuple(str(name) for name in samples["name"].values),
        sample_estimate=array(samples, "estimate"),
        statistics={}
        if statistics is None
        else {str(name): array(statistics, str(name)) for name in statistics.data_vars},
        draws=array(root, "draws") if "draws" in root else None,
        **{
            name: array(root, name)
            for name in ("wavelength_nm", *PARAMETERS, "covariance", "quantile", "status")
        },
        **{
            name: array(samples, name)
            for name in (
                "thickness_mm",
                "sample_status",
                "distance",
                "residual",
                "residual_normalised",
                "beer_sigma_t_per_mm",
                "beer_standard_error_per_mm",
            )
        },
    )
