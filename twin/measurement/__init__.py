"""Measurements: one visit to the bench as one object, one file, and relative intensities."""

from __future__ import annotations

from pathlib import Path

from twin.measurement.folder import read_folder
from twin.measurement.jcamp import JcampSettings, read_jcamp
from twin.measurement.model import (
    CAPTURES,
    REFERENCE_CAPTURES,
    SAMPLE_CAPTURES,
    Captures,
    Measurement,
    Provenance,
    RelativeRow,
    RelativeSpectra,
    Shot,
    Truth,
)
from twin.measurement.netcdf import read_netcdf, write_measurement
from twin.measurement.observations import Observations, observations
from twin.measurement.oceanview import OceanViewSettings, read_oceanview
from twin.measurement.relative import (
    BlackReflectance,
    RelativeIntensities,
    certified_white,
    measured_black_reflectance,
    relative_intensities,
)
from twin.measurement.rxt import SphereVisit, read_rxt
from twin.measurement.seen import seen_truth
from twin.measurement.written import write_folder


def read_measurement(path: str | Path) -> Measurement:
    """Read a measurement from a netCDF-4 file or from a folder made by hand.

    Raises:
        InputError: one message with file, place, found and expected.
    """
    return read_folder(path) if Path(path).is_dir() else read_netcdf(path)


__all__ = [
    "CAPTURES",
    "REFERENCE_CAPTURES",
    "SAMPLE_CAPTURES",
    "BlackReflectance",
    "Captures",
    "JcampSettings",
    "Measurement",
    "Observations",
    "OceanViewSettings",
    "Provenance",
    "RelativeIntensities",
    "RelativeRow",
    "RelativeSpectra",
    "Shot",
    "SphereVisit",
    "Truth",
    "certified_white",
    "measured_black_reflectance",
    "observations",
    "read_folder",
    "read_jcamp",
    "read_measurement",
    "read_netcdf",
    "read_oceanview",
    "read_rxt",
    "relative_intensities",
    "seen_truth",
    "write_folder",
    "write_measurement",
]
