"""Fluorescence as a sum of Gaussians in (excitation, emission), and the export of an estimate.

Source: Iser, Lachiver, Wilkie 2023, section 3.2 (equations 5 and 6), after Hua et al. 2022.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, ValidationError

from twin.errors import InputError
from twin.files import write_atomically
from twin.fluorescence.donaldson import GRID_NM, DonaldsonMatrix
from twin.spectra import FloatArray, Part
from twin.toml import input_error, read_text

FORMAT = "benchtwin fluorescence mixture"
BIN_NM = 10.0
"""Width [nm] of the emission bin that a mixture's values belong to."""


class Gaussian(Part):
    """One Gaussian without rotation: weight times the two-dimensional normal density."""

    weight: float = Field(ge=0)
    """Weight [nm^2]: the peak is weight / (2 pi sqrt(variance product))."""
    excitation_nm: float
    """Mean excitation wavelength [nm]."""
    emission_nm: float
    """Mean emission wavelength [nm]."""
    excitation_variance_nm2: float = Field(gt=0)
    """Variance [nm^2] along the excitation."""
    emission_variance_nm2: float = Field(gt=0)
    """Variance [nm^2] along the emission."""


class MixtureModel(Part):
    """A Donaldson matrix as a Gaussian mixture and a diagonal given by its MESE moments."""

    format: str = FORMAT
    name: str = ""
    bin_nm: float = Field(default=BIN_NM, gt=0)
    """The Gaussians give energy per emission bin of this width; finer bins get less of it."""
    range_nm: tuple[float, float] = (400.0, 700.0)
    """Wavelengths [nm] of the phases -pi and 0 of the moments."""
    gaussians: tuple[Gaussian, ...] = ()
    moments: tuple[float, ...] = ()
    """Trigonometric moments c_0, c_1 ... of the diagonal (bounded MESE, Peters et al. 2019)."""


def gaussian_mixture(
    weight: ArrayLike,
    mean_nm: ArrayLike,
    variance_nm2: ArrayLike,
    emission_nm: ArrayLike = GRID_NM,
    excitation_nm: ArrayLike = GRID_NM,
) -> FloatArray:
    """Fluorescence cells of M Gaussians, 0 where emission is not longer than excitation.

        f(x) = sum_m w_m N(x | mu_m, diag(variance_m)),   x = (excitation, emission)

    Args:
        weight: shape (M,), 0 or more.
        mean_nm: means [nm], columns excitation and emission, shape (M, 2).
        variance_nm2: variances [nm^2], the same columns, above 0, shape (M, 2).
        emission_nm: rows, shape (Wo,).
        excitation_nm: columns, shape (Wi,).

    Returns:
        Shape (Wo, Wi), in energy per emission bin of 10 nm.

    Raises:
        InputError: other shapes, a negative weight, a variance of 0 or below, no number.
    """
    w = np.asarray(weight, dtype=np.float64)
    mean = np.asarray(mean_nm, dtype=np.float64)
    variance = np.asarray(variance_nm2, dtype=np.float64)
    if w.ndim != 1 or mean.shape != (w.size, 2) or variance.shape != (w.size, 2):
        raise InputError(
            f"weights {w.shape}, means {mean.shape}, variances {variance.shape}",
            "shapes (M,), (M, 2) and (M, 2)", place="mixture",
        )  # fmt: skip
    good = np.isfinite(w) & (w >= 0) & np.isfinite(mean).all(1) & np.isfinite(variance).all(1)
    good &= (variance > 0).all(axis=1)
    if not good.all():
        raise InputError(
            f"Gaussian {int(np.argmin(good)) + 1} with a negative weight, a variance of 0 or below,"
            " or no number", "weights of 0 or more and variances above 0", place="mixture",
        )  # fmt: skip
    emission, excitation = np.asarray(emission_nm, float), np.asarray(excitation_nm, float)
    into = np.exp(-0.5 * (excitation - mean[:, :1]) ** 2 / variance[:, :1])
    out = np.exp(-0.5 * (emission - mean[:, 1:]) ** 2 / variance[:, 1:])
    peak = w / (2.0 * np.pi * np.sqrt(variance.prod(axis=1)))
    cells = np.einsum("m,mo,mi->oi", peak, out, into)
    return np.where(emission[:, None] > excitation[None, :] + 1e-6, cells, 0.0)


def from_mixture(
    model: MixtureModel,
    *,
    reflectance: ArrayLike | None = None,
    emission_nm: ArrayLike = GRID_NM,
    excitation_nm: ArrayLike = GRID_NM,
) -> DonaldsonMatrix:
    """The Donaldson matrix of a mixture and a diagonal.

    Args:
        model: Gaussians, and the moments of the diagonal.
        reflectance: the diagonal at the emission wavelengths instead of the moments, (Wo,).
        emission_nm: rows, (Wo,), inside the model's range when moments give the diagonal.
        excitation_nm: columns, (Wi,).

    Raises:
        InputError: neither moments nor a reflectance, or moments that no reflectance has.
    """
    emission = np.asarray(emission_nm, dtype=np.float64)
    excitation = np.asarray(excitation_nm, dtype=np.float64)
    if reflectance is not None:
        diagonal = np.broadcast_to(np.asarray(reflectance, dtype=np.float64), emission.shape)
    elif model.moments:
        from twin.fluorescence.mese import reconstruct

        value, valid = reconstruct(np.array(model.moments), emission, model.range_nm)
        if not bool(valid):
            raise InputError(
                f"moments {', '.join(f'{c:g}' for c in model.moments)}",
                "those of a spectrum between 0 and 1", place="moments",
            )  # fmt: skip
        diagonal = np.asarray(value)
    else:
        raise InputError("no diagonal", "moments, or a reflectance", place="moments")
    arrays = (
        np.array([g.weight for g in model.gaussians]),
        np.array([(g.excitation_nm, g.emission_nm) for g in model.gaussians]).reshape(-1, 2),
        np.array(
            [(g.excitation_variance_nm2, g.emission_variance_nm2) for g in model.gaussians]
        ).reshape(-1, 2),
    )
    step = emission[1] - emission[0] if emission.size > 1 else model.bin_nm
    cells = gaussian_mixture(*arrays, emission, excitation) * (step / model.bin_nm)
    same = np.abs(emission[:, None] - excitation[None, :]) < 1e-6
    return DonaldsonMatrix(
        cells + same * diagonal[:, None], emission, excitation, name=model.name, source="mixture"
    )


def write_mixture(model: MixtureModel, path: str | Path) -> Path:
    """Write a mixture as JSON for renderers, atomically; the path is returned.

    Raises:
        InputError: the folder cannot be written.
    """
    text = json.dumps(model.model_dump(mode="json"), indent=2) + "\n"
    return write_atomically(Path(path), text.encode())


def read_mixture(path: str | Path) -> MixtureModel:
    """Read a mixture from JSON.

    Raises:
        InputError: not such a file, or numbers that cannot be.
    """
    path = Path(path)
    text = read_text(path)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a mistake: {error}", "JSON", file=path) from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError("JSON of another make", f'"format": "{FORMAT}"', file=path)
    try:
        return MixtureModel.model_validate(data)
    except ValidationError as error:
        raise input_error(error, data, MixtureModel, file=path) from error


def write_matrix_csv(matrix: DonaldsonMatrix, path: str | Path) -> Path:
    """Write a Donaldson matrix as CSV, atomically; the path is returned.

    First row: "emission_nm" and the excitation wavelengths; one row for each emission wavelength.
    Energy units, bin width included; numbers are written so that they come back exactly.

    Raises:
        InputError: the folder cannot be written.
    """
    lines = ["emission_nm," + ",".join(f"{w:.10g}" for w in matrix.excitation_nm)]
    for wavelength, row in zip(matrix.emission_nm, matrix.matrix, strict=True):
        lines.append(f"{wavelength:.10g}," + ",".join(repr(float(value)) for value in row))
    return write_atomically(Path(path), ("\n".join(lines) + "\n").encode())


def read_matrix_csv(path: str | Path, *, below: str = "error") -> DonaldsonMatrix:
    """Read a Donaldson matrix from the CSV that `write_matrix_csv` writes.

    Raises:
        InputError: another layout, or a number that cannot be; says the line.
    """
    path = Path(path)
    rows = [
        (number, line.split(","))
        for number, line in enumerate(read_text(path).splitlines(), start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not rows or rows[0][1][0].strip() != "emission_nm":
        raise InputError(
            repr(rows[0][1][0][:30]) if rows else "an empty file",
            "emission_nm and the excitation wavelengths in the first line", file=path,
            place="line 1",
        )  # fmt: skip
    width = len(rows[0][1])
    table: list[list[float]] = []
    for number, fields in rows:
        if len(fields) != width:
            raise InputError(
                f"{len(fields)} columns", f"{width}, as in the first line", file=path,
                place=f"line {number}",
            )  # fmt: skip
        try:
            table.append([float(each) for each in (fields if table else ["nan", *fields[1:]])])
        except ValueError as error:
            raise InputError(
                f"a mistake: {error}", "numbers", file=path, place=f"line {number}"
            ) from error
    values = np.array(table)
    try:
        return DonaldsonMatrix(
            values[1:, 1:], values[1:, 0], values[0, 1:],
            name=path.stem, source=path.name, below=below,  # type: ignore[arg-type]
        )  # fmt: skip
    except InputError as error:
        raise error.at(path) from error
