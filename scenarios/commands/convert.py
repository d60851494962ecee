"""`benchtwin convert`: a measurement as netCDF, or as a folder of tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenarios.outputs import prepare_file
from twin.errors import InputError


def convert_measurement(source: Path, out: Path) -> dict[str, Any]:
    """Read a measurement and write it as the other kind of file; nothing in it changes.

    Args:
        source: a measurement.nc, or a folder (tables, or exported spectra with files.toml).
        out: ends with .nc: the netCDF file; else an empty or a new folder for the tables.

    Raises:
        InputError: the measurement cannot be read, or `out` cannot be written.
    """
    from twin.measurement import read_measurement, write_folder, write_measurement

    if source.resolve() == out.resolve():
        raise InputError("the same path twice", "another path to write to", file=out)
    measurement = read_measurement(source)
    if out.suffix.lower() == ".nc":
        files = [write_measurement(measurement, prepare_file(out))]
    else:
        try:
            files = sorted(write_folder(measurement, out).iterdir())
        except InputError as error:
            raise (error if error.file else error.at(source)) from error
    return {
        "measurement": str(out),
        "files": [path.name for path in files],
        "origin": measurement.provenance.origin,
        "samples": [sample.name for sample in measurement.samples],
        "notes": list(measurement.provenance.notes),
        "fingerprint": measurement.fingerprint,
    }
