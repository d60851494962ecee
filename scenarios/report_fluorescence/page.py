"""The report of a fluorescence estimate as one offline HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.fluorescence.facts import ESTIMATOR_NOTES, errors_of, regions
from twin.files import write_atomically
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.fluorescence import FluorescenceResult
    from scenarios.report_fluorescence.colour import Appearance
    from twin.fluorescence import FluorescenceData, FluorescenceVisit, Illuminant, MixtureModel

_GOOD, _MIXED = ("OK",), ("NO_FLUORESCENCE_SEEN", "NO_NOISE_STATED", "UNDETERMINED_CELLS", "MASKED")


def write_fluorescence_report(
    visit: FluorescenceVisit,
    data: FluorescenceData,
    result: FluorescenceResult,
    path: str | Path,
    *,
    mixture: MixtureModel | None = None,
    title: str = "",
    command: str = "",
    notes: Sequence[str] = (),
) -> Path:
    """Write the report as one HTML file, atomically; the path is returned.

    Args:
        visit: what was measured.
        data: its corrected captures.
        result: the estimate.
        path: where to.
        mixture: its export as Gaussians and moments, to be listed.
        title: of the scenario.
        command: what repeats the run, or "".
        notes: what else is to be said, in words.

    Raises:
        InputError: the folder cannot be written.
    """
    page = fluorescence_page(
        visit, data, result, mixture=mixture, title=title, command=command, notes=notes
    )
    return write_atomically(Path(path), page.encode())


def fluorescence_page(
    visit: FluorescenceVisit,
    data: FluorescenceData,
    result: FluorescenceResult,
    *,
    mixture: MixtureModel | None = None,
    title: str = "",
    command: str = "",
    notes: Sequence[str] = (),
) -> str:
    """The page as text: the same estimate gives the same text.

    Args:
        visit: what was measured.
        data: its corrected captures.
        result: the estimate.
        mixture: its export as Gaussians and moments, to be listed.
        title: of the scenario.
        command: what repeats the run, or "".
        notes: what else is to be said, in words.
    """
    import jinja2
    from markupsafe import Markup

    from scenarios.report_fluorescence.colour import appearance, lights_for
    from scenarios.report_fluorescence.fit_plot import draw_fit
    from scenarios.report_fluorescence.matrix_plot import draw_matrices
    from scenarios.report_fluorescence.setup_plot import draw_setup
    from scenarios.report_fluorescence.spectra_plot import (
        draw_diagonal,
        draw_differences,
        draw_reflected,
    )
    from scenarios.simulate import software

    truth = None
    if data.truth is not None:
        truth = data.truth.on(result.emission_nm, result.excitation_nm).matrix
    looks = [
        appearance(
            light, result.matrix, result.emission_nm, result.excitation_nm, draws=result.draws,
            truth=truth,
        )
        for light in lights_for(result.excitation_nm)
    ]  # fmt: skip
    figures = {
        "matrix": draw_matrices(result, truth),
        "diagonal": draw_diagonal(result, truth),
        "reflected": draw_reflected(looks, result.emission_nm, result.excitation_nm),
        "differences": draw_differences(result, truth),
        "fit": draw_fit(data, result),
        "setup": draw_setup(visit.setup, data),
    }
    style = resources.files("scenarios.report").joinpath("style.css").read_text("utf-8")
    text = resources.files("scenarios.report_fluorescence").joinpath("page.html.j2")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    errors = errors_of(result, data.truth) if data.truth is not None else None
    return environment.from_string(text.read_text("utf-8")).render(
        style=Markup(style),
        figures={name: Markup(svg) if svg else None for name, svg in figures.items()},
        tone=_tone(result),
        verdict=result.status.cause,
        remedy=result.status.remedy,
        messages=[_sentence(each) for each in (*result.messages, *notes)],
        undetermined=regions(result.undetermined, result.emission_nm, result.excitation_nm),
        tiles=_tiles(result, data, errors),
        swatches=[_swatch(look) for look in looks],
        has_truth=truth is not None,
        fit_note=_fit_note(result),
        has_intervals=bool(np.isfinite(result.quantile).all()),
        errors=_error_rows(errors),
        sample=visit.sample,
        title=title or "Fluorescence",
        estimator=result.estimator,
        about=ESTIMATOR_NOTES.get(result.estimator, ""),
        parts=_parts(visit),
        price=f"{visit.setup.price_usd:,.0f}".replace(",", " "),
        setup_name=visit.setup.name,
        gaussians=_gaussians(mixture),
        gaussians_stored=len(mixture.gaussians) if mixture is not None else 0,
        moments=", ".join(f"{c:.4g}" for c in mixture.moments) if mixture is not None else "",
        settings=[[key, str(value)] for key, value in sorted(result.settings.items())],
        statistics=[[k.replace("_", " "), f"{v:.4g}"] for k, v in result.statistics.items()],
        command=command,
        origin=visit.provenance.software or "made by hand",
        seed=visit.provenance.seed,
        fingerprint=visit.fingerprint,
        result_fingerprint=result.fingerprint,
        software=software(),
    )


def _tone(result: FluorescenceResult) -> str:
    if result.status.name in _GOOD:
        return "good"
    return "mixed" if result.status.name in _MIXED else "poor"


def _fit_note(result: FluorescenceResult) -> str:
    """What the residuals are of: the reported matrix, or the fit before its limits."""
    found = result.statistics.get("chi_square"), result.statistics.get("directions")
    if found[0] is None or found[1] is None:
        return ""
    return (
        " Shown is the reported matrix, whose cells are kept at 0 or above; single cells lit by"
        f" strong light can stand out for that. The fit before that limit has chi-square"
        f" {found[0]:.0f} with {found[1]:.0f} independent captures."
    )


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


def _tiles(
    result: FluorescenceResult, data: FluorescenceData, errors: dict[str, float | None] | None
) -> list[dict[str, str]]:
    cells = result.fluorescence
    row, column = np.unravel_index(int(cells.argmax()), cells.shape)
    yields = result.donaldson.photon_yield
    best = int(yields.argmax())
    top = float(cells[row, column])
    note = f"excited at {result.excitation_nm[column]:g}, emitted at {result.emission_nm[row]:g} nm"
    interval = result.interval[:, row, column]
    if np.isfinite(interval).all():
        note += f"; 90 %: {interval[0]:.4f} to {interval[1]:.4f}"
    tiles = [
        {"name": "brightest cell of the fluorescence", "number": f"{top:.4f}", "note": note},
        {
            "name": "largest photon yield",
            "number": f"{100 * yields[best]:.0f} %",
            "note": f"photons emitted per photon at {result.excitation_nm[best]:g} nm",
        },
        {
            "name": "reflectance",
            "number": f"{result.reflectance.min():.2f} to {result.reflectance.max():.2f}",
            "note": "least and greatest of the diagonal",
        },
    ]
    if errors is not None:
        tiles.append(
            {
                "name": "error of the fluorescence (RMSE)",
                "number": f"{errors['rmse_fluorescence']:.2g}",
                "note": f"{100 * (errors['rmse_fluorescence'] or 0) / max(top, 1e-9):.1f} % of the"
                f" brightest cell; of the reflectance {errors['rmse_reflectance']:.2g}",
            }
        )
    else:
        used = int(data.valid.sum())
        tiles.append(
            {
                "name": "captures used",
                "number": f"{used} of {data.valid.size}",
                "note": "illuminants times channels",
            }
        )
    return tiles


def _swatch(look: Appearance) -> dict[str, Any]:
    lab = look.patch.lab
    words = [f"L* {lab[0]:.1f}, a* {lab[1]:.1f}, b* {lab[2]:.1f}"]
    if look.uncertainty is not None:
        words.append(f"90 % of the draws within {look.uncertainty:.2g} ΔE00")
    if look.exposure != 1.0:
        words.append(f"shown {look.exposure:.3g} times as bright")
    if not look.patch.in_gamut:
        words.append("outside sRGB: the nearest colour is shown")
    return {
        "light": look.light.name,
        "estimate": look.patch.hexadecimal,
        "truth": look.truth_patch.hexadecimal if look.truth_patch is not None else None,
        "difference": f"{look.difference:.2f} ΔE00" if look.difference is not None else "",
        "words": "; ".join(words),
    }


def _error_rows(errors: dict[str, float | None] | None) -> list[list[str]]:
    if errors is None:
        return []
    names = {
        "rmse_fluorescence": "RMSE of the cells of the fluorescence",
        "rmse_reflectance": "RMSE of the reflectance",
        "ciede2000_monochromatic_median": "CIEDE2000 under light of one wavelength, median",
        "share_in_90_percent_interval": "Cells of the fluorescence inside their 90 % interval",
        "share_in_90_percent_interval_reflectance": "Reflectances inside theirs",
    }
    rows = []
    for key, text in names.items():
        value = errors[key]
        if value is None:
            shown = "no intervals"
        elif key.startswith("share"):
            shown = f"{100 * value:.0f} %"
        else:
            shown = f"{value:.3g}"
        rows.append([text, shown])
    return rows


def _parts(visit: FluorescenceVisit) -> list[list[str]]:
    setup = visit.setup
    rows = [["Price of lights and detector", f"{setup.price_usd:g} USD"]]
    for number, light in enumerate(setup.lights, start=1):
        name = light.name.replace("_", " ")
        rows.append([f"Illuminant {number}", f"{name} ({_kind(light)})"])
    detector = setup.detector
    wavelength: FloatArray = np.asarray(detector.wavelength_nm)
    rows.append(
        [
            "Detector",
            f"{detector.kind}, {len(setup.channel_names)} channels,"
            f" {wavelength[0]:g} to {wavelength[-1]:g} nm",
        ]
    )
    white = setup.white
    known = f"reflectance {white:g}" if isinstance(white, (int, float)) else "a certified spectrum"
    rows.append(["White standard", known])
    times = sorted({shot.integration_s for shot in visit.shots})
    lasted = f"{times[0]:.3g} s" if len(times) == 1 else f"{times[0]:.3g} to {times[-1]:.3g} s"
    rows.append(["Shots", f"{len(visit.shots)}, {lasted} each"])
    return rows


def _kind(light: Illuminant) -> str:
    """What a light is, in words."""
    match light.kind:
        case "led":
            return f"LED, peak {light.peak_nm:g} nm, {light.fwhm_nm:g} nm wide"
        case "monochromatic":
            return f"monochromator, {light.centre_nm:g} nm"
        case "filtered":
            return "filter on a white panel"
        case "lamp":
            return "white lamp"
        case "table":
            return "sampled spectrum"


def _gaussians(mixture: MixtureModel | None) -> list[list[str]]:
    """Rows of the Gaussians that have a weight, the greatest first."""
    if mixture is None:
        return []
    return [
        [
            f"{g.weight:.4g}", f"{g.excitation_nm:.1f}", f"{g.emission_nm:.1f}",
            f"{g.excitation_variance_nm2**0.5:.1f}", f"{g.emission_variance_nm2**0.5:.1f}",
        ]
        for g in sorted(mixture.gaussians, key=lambda g: -g.weight)
        if g.weight > 0.0
    ]  # fmt: skip
