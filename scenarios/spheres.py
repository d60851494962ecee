"""From an `.rxt` file of the inverse adding-doubling community to optical properties on disk.

estimate = estimate_rxt("phantom.rxt", g=0.9, settings=SphereSettings(method="comparison"))
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from estimators.result import Status
from estimators.sphere import SphereEstimator, SphereSettings
from estimators.sphere_result import SphereEstimate
from twin.errors import InputError
from twin.files import write_atomically
from twin.measurement.rxt import READINGS, read_rxt
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURED, REFERENCE = "#0072B2", "#D55E00"
_RESULT_ROW = re.compile(r"\s*([-+.\deE]+)(\s+[-+.\deE]+){7}\s*[*!?-]?.*")


class ReferenceResult(NamedTuple):
    """What the program iad found: wavelength [nm], mu_a, mu_s' [1/mm] and g, (W,) each."""

    wavelength_nm: FloatArray
    mu_a_per_mm: FloatArray
    mu_s_prime_per_mm: FloatArray
    g: FloatArray


def estimate_rxt(
    path: str | Path,
    *,
    g: float | None = None,
    out: str | Path | None = None,
    settings: SphereSettings | None = None,
    reference: ReferenceResult | None = None,
) -> SphereEstimate:
    """Estimate the material behind one file.

    Args:
        path: the `.rxt` file.
        g: anisotropy factor where it is not found; None takes the settings', the file's, or 0.
        out: folder for NAME.json, NAME.csv and NAME.svg; it is made. None: nothing is written.
        settings: everything else, see `estimators.sphere.SphereSettings`; the file says
            neither whether the instrument has two beams nor at which angle light comes in.
        reference: another result to draw beside this one.

    Raises:
        InputError: the file or the settings cannot be used, or `out` cannot be written.
    """
    chosen = settings or SphereSettings()
    if g is not None:
        chosen = dataclasses.replace(chosen, g=float(g))
    visit = read_rxt(path)
    estimate = SphereEstimator(chosen).estimate(visit)
    hints = [text for text in visit.comments if "iad " in text]
    if hints:
        said = tuple(f"A comment of the file says: {text}" for text in hints)
        estimate = dataclasses.replace(estimate, messages=estimate.messages + said)
    if out is not None:
        write_outputs(estimate, Path(out), Path(path).stem, reference)
    return estimate


def write_outputs(
    estimate: SphereEstimate, folder: Path, name: str, reference: ReferenceResult | None = None
) -> list[Path]:
    """Write NAME.json, NAME.csv and NAME.svg into a folder.

    Raises:
        InputError: a place that cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            error.strerror or str(error), "a folder that can be written", file=folder
        ) from error
    text = json.dumps(summary(estimate), indent=2, allow_nan=False) + "\n"
    return [
        write_atomically(folder / f"{name}.json", text.encode()),
        write_csv(estimate, folder / f"{name}.csv"),
        write_atomically(folder / f"{name}.svg", spectrum_svg(estimate, reference)),
    ]


def summary(estimate: SphereEstimate) -> dict[str, Any]:
    """Medians, counts and messages in the types of JSON; what is not finite becomes null."""
    errors = estimate.derived_standard_error()
    columns = {
        "mu_a_per_mm": (estimate.mu_a_per_mm, errors[:, 0]),
        "mu_s_per_mm": (estimate.mu_s_per_mm, errors[:, 1]),
        "mu_s_prime_per_mm": (estimate.mu_s_prime_per_mm, errors[:, 2]),
        "albedo": (estimate.albedo, estimate.standard_error[:, 0]),
        "sigma_t_per_mm": (estimate.sigma_t_per_mm, estimate.standard_error[:, 1]),
        "g": (estimate.g, estimate.standard_error[:, 2]),
    }
    wavelength = estimate.wavelength_nm[np.isfinite(estimate.wavelength_nm)]
    return {
        "estimator": estimate.estimator,
        "source": estimate.source,
        "rows": len(estimate.status),
        "wavelength_nm": [float(wavelength.min()), float(wavelength.max())]
        if wavelength.size
        else None,
        "status": estimate.counts(),
        "g_held_rows": int(estimate.g_held.sum()),
        "median": {k: _median(v) for k, (v, _) in columns.items()},
        "median_standard_error": {k: _median(e) for k, (_, e) in columns.items()},
        "largest_residual": {
            name: _plain(np.max(np.abs(column), initial=0.0, where=np.isfinite(column)))
            for name, column in zip(READINGS, estimate.residual.T, strict=True)
        },
        "settings": dict(estimate.settings),
        "messages": list(estimate.messages),
    }


def summary_text(estimate: SphereEstimate) -> str:
    """The summary for people, one fact a line."""
    facts = summary(estimate)
    lines = [f"{facts['source']}: {facts['rows']} rows"]
    lines.append("  " + ", ".join(f"{n} {name}" for name, n in facts["status"].items()))
    for name, unit in (("mu_a_per_mm", " /mm"), ("mu_s_prime_per_mm", " /mm"), ("g", "")):
        value, error = facts["median"][name], facts["median_standard_error"][name]
        if value is not None:
            shown = f" +- {error:.2g}" if error else ""
            lines.append(f"  median {name.removesuffix('_per_mm')}: {value:.4g}{shown}{unit}")
    lines.extend(f"  {message}" for message in facts["messages"])
    return "\n".join(lines) + "\n"


def write_csv(estimate: SphereEstimate, path: str | Path) -> Path:
    """One line per row: properties, standard errors, readings and their fit; "" for NaN.

    Raises:
        InputError: a place that cannot be written.
    """
    errors, own = estimate.derived_standard_error(), estimate.standard_error
    columns: dict[str, FloatArray] = {
        "wavelength_nm": estimate.wavelength_nm,
        "mu_a_per_mm": estimate.mu_a_per_mm,
        "mu_a_standard_error_per_mm": errors[:, 0],
        "mu_s_per_mm": estimate.mu_s_per_mm,
        "mu_s_standard_error_per_mm": errors[:, 1],
        "mu_s_prime_per_mm": estimate.mu_s_prime_per_mm,
        "mu_s_prime_standard_error_per_mm": errors[:, 2],
        "albedo": estimate.albedo,
        "albedo_standard_error": own[:, 0],
        "sigma_t_per_mm": estimate.sigma_t_per_mm,
        "sigma_t_standard_error_per_mm": own[:, 1],
        "g": estimate.g,
        "g_standard_error": own[:, 2],
    }
    for index, name in enumerate(READINGS):
        columns[name] = estimate.value[:, index]
        columns[f"{name}_sigma"] = estimate.sigma[:, index]
        columns[f"{name}_fit"] = estimate.fitted[:, index]
    lines = [",".join([*columns, "g_held", "status"])]
    for row in range(len(estimate.status)):
        cells = [
            f"{values[row]:.9g}" if math.isfinite(values[row]) else ""
            for values in columns.values()
        ]
        cells += [str(int(estimate.g_held[row])), Status(int(estimate.status[row])).name.lower()]
        lines.append(",".join(cells))
    return write_atomically(Path(path), ("\n".join(lines) + "\n").encode())


def read_iad_result(path: str | Path) -> ReferenceResult:
    """Read the table that the program iad prints (wavelength, readings, mu_a, mu_s', g).

    Raises:
        InputError: a file without such rows.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="latin-1").splitlines()
    except OSError as error:
        raise InputError(
            f"a file that cannot be read ({error.strerror})", "a result of iad", file=path
        ) from error
    rows = []
    for number, line in enumerate(lines, start=1):
        if line.lstrip().startswith("#") or not _RESULT_ROW.fullmatch(line):
            continue
        try:
            rows.append([float(cell) for cell in line.split()[:8]])
        except ValueError as error:
            raise InputError(
                f"{line.strip()[:40]!r}", "eight numbers", file=path, place=f"line {number}"
            ) from error
    if not rows:
        raise InputError("no rows of eight numbers", "a result of iad", file=path)
    table = np.array(rows)
    return ReferenceResult(table[:, 0], table[:, 5], table[:, 6], table[:, 7])


def spectrum_figure(estimate: SphereEstimate, reference: ReferenceResult | None = None) -> Figure:
    """mu_a and mu_s' over wavelength (or row) with bands of two standard errors.

    A reference result is drawn as dots beside it.
    """
    from matplotlib.figure import Figure

    named = bool(np.isfinite(estimate.wavelength_nm).all())
    x = estimate.wavelength_nm if named else np.arange(1.0, len(estimate.status) + 1.0)
    order = np.argsort(x, kind="stable")
    errors = estimate.derived_standard_error()
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    panels = (
        ("absorption μₐ  [1/mm]", estimate.mu_a_per_mm, errors[:, 0], 1),
        ("reduced scattering μₛ′  [1/mm]", estimate.mu_s_prime_per_mm, errors[:, 2], 2),
    )
    for axis, (label, value, error, column) in zip(axes, panels, strict=True):
        value, error = value[order], error[order]
        if named:
            axis.fill_between(
                x[order], np.maximum(value - 2 * error, 0.0), value + 2 * error,
                color=MEASURED, alpha=0.2, linewidth=0, label="± 2 standard errors",
            )  # fmt: skip
            axis.plot(x[order], value, color=MEASURED, linewidth=1.4, label="benchtwin")
        else:
            # rows without a wavelength are samples: nothing lies between them
            axis.errorbar(
                x[order], value, yerr=2 * error, fmt="o", color=MEASURED, markersize=4,
                capsize=2, linewidth=1, label="benchtwin, ± 2 standard errors",
            )  # fmt: skip
        if reference is not None:
            axis.plot(
                reference.wavelength_nm, reference[column], ".", color=REFERENCE,
                markersize=4, label="result of iad",
            )  # fmt: skip
        finite = value[np.isfinite(value)]
        if finite.size:
            axis.set_ylim(0.0, 1.25 * max(float(finite.max()), 1e-6))
        axis.set_ylabel(label)
        axis.grid(alpha=0.25, linewidth=0.6)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    axes[0].legend(frameon=False, loc="upper left", ncols=3)
    axes[1].set_xlabel("wavelength [nm]" if named else "row of the file")
    figure.suptitle(Path(estimate.source).name, fontsize=11)
    return figure


def spectrum_svg(estimate: SphereEstimate, reference: ReferenceResult | None = None) -> bytes:
    """The figure as SVG; the same estimate gives the same bytes."""
    import io

    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "benchtwin spheres", "svg.fonttype": "path"}):
        buffer = io.BytesIO()
        spectrum_figure(estimate, reference).savefig(
            buffer, format="svg", metadata={"Date": None, "Creator": None}
        )
    return buffer.getvalue()


def _median(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return _plain(np.median(finite)) if finite.size else None


def _plain(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
