"""Published measurements with integrating spheres: a silicone phantom, Intralipid, ink, TiO2.

Data: tests of Prahl's inverse adding-doubling (MIT), read from beside the repository. The
phantom comes with its author's own result (iad 3.16.2: `-X -i 8 -g 0.9`, dual beam, light at 8
degrees, g 0.9, lost light by Monte Carlo), and the same settings are used here.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from twin.spectra import FloatArray

FOLDER = Path(__file__).resolve().parents[1] / ".." / "shared/data/translucent/iad_rxt"
# The files name no concentrations. Each series runs through dilutions in equal steps (il_A
# 8 7 6 5 4 twice; il_B 8 to 2 thrice, then 8 7 6): an assumption, and the only free one is
# the unit, since the line is also fitted through the origin.
IL_STEPS = {
    "il_A": np.tile(np.arange(8.0, 3.0, -1.0), 2),
    "il_B": np.concatenate([np.tile(np.arange(8.0, 1.0, -1.0), 3), [8.0, 7.0, 6.0]]),
}


def line(x: FloatArray, y: FloatArray, *, through_origin: bool) -> dict[str, float]:
    """Least-squares line: slope, intercept, R^2 (about the mean) and relative residual (rms)."""
    columns = [x] if through_origin else [x, np.ones_like(x)]
    matrix = np.stack(columns, axis=1)
    solution, *_ = np.linalg.lstsq(matrix, y, rcond=None)
    residual = y - matrix @ solution
    spread = y - y.mean()
    return {
        "slope": float(solution[0]),
        "intercept": 0.0 if through_origin else float(solution[1]),
        "r2": float(1.0 - (residual @ residual) / (spread @ spread)),
        "rms_relative_residual": float(np.sqrt(np.mean((residual / y) ** 2))),
    }


def phantom(quick: bool) -> dict[str, object]:
    """The silicone phantom against its author's result, with and without the lost light."""
    from estimators.sphere import SphereSettings
    from scenarios.spheres import estimate_rxt, read_iad_result

    author = read_iad_result(FOLDER / "phantom_with_no_slides.result.txt")

    def differences(*, g: float, lost: bool) -> tuple[FloatArray, FloatArray]:
        settings = SphereSettings(
            method="comparison", incidence_deg=8.0, lost_light=lost, log2_paths=14 if quick else 17
        )
        found = estimate_rxt(FOLDER / "phantom_with_no_slides.rxt", g=g, settings=settings)
        if not np.array_equal(found.wavelength_nm, author.wavelength_nm):
            raise RuntimeError("the author's result lists other wavelengths than the measurement")
        return (
            found.mu_a_per_mm / author.mu_a_per_mm - 1.0,
            found.mu_s_prime_per_mm / author.mu_s_prime_per_mm - 1.0,
        )

    figures: dict[str, object] = {}
    cases = {"": (0.9, True), "_lost_light_ignored": (0.9, False)}
    if not quick:
        cases["_g_0.8"] = (0.8, True)
        cases["_g_0"] = (0.0, True)
    for suffix, (g, lost) in cases.items():
        a, s = differences(g=g, lost=lost)
        figures[f"median_difference_mu_a{suffix}"] = float(np.median(np.abs(a)))
        figures[f"median_difference_mu_s_prime{suffix}"] = float(np.median(np.abs(s)))
        if not suffix:
            figures["max_difference_mu_a"] = float(np.max(np.abs(a)))
            figures["max_difference_mu_s_prime"] = float(np.max(np.abs(s)))
            figures["mean_difference_mu_a"] = float(np.mean(a))
            figures["mean_difference_mu_s_prime"] = float(np.mean(s))
    return figures


def intralipid() -> dict[str, object]:
    """Dilutions of Intralipid: does scattering follow the concentration?"""
    from scenarios.spheres import estimate_rxt

    figures: dict[str, object] = {}
    for name, step in IL_STEPS.items():
        found = estimate_rxt(FOLDER / f"{name}.rxt")
        scattering = found.mu_s_per_mm
        repeats = [scattering[step == value] for value in np.unique(step)]
        scatter = [values.std(ddof=1) / values.mean() for values in repeats if values.size > 1]
        figures[name] = {
            "sigma_s_against_step": line(step, scattering, through_origin=False),
            "sigma_s_proportional": line(step, scattering, through_origin=True),
            "mu_s_prime_proportional": line(step, found.mu_s_prime_per_mm, through_origin=True),
            # needs no concentrations: a dilution keeps g
            "mu_s_prime_against_sigma_s": line(
                scattering, found.mu_s_prime_per_mm, through_origin=True
            ),
            "repeatability_sigma_s": float(np.median(scatter)),
            "g": [float(found.g.min()), float(np.median(found.g)), float(found.g.max())],
            "mu_a_per_mm": [float(found.mu_a_per_mm.min()), float(found.mu_a_per_mm.max())],
            "status": found.counts(),
        }
    return figures


def ink() -> dict[str, object]:
    """Dilutions of ink: absorption against extinction, which needs no concentrations."""
    from scenarios.spheres import estimate_rxt

    figures: dict[str, object] = {}
    for name in ("ink_A", "ink_B"):
        found = estimate_rxt(FOLDER / f"{name}.rxt")
        usable = found.identifiable[:, :2].all(axis=1)
        figures[name] = {
            "rows": int(usable.size),
            "rows_used": int(usable.sum()),
            "mu_a_against_sigma_t": line(
                found.sigma_t_per_mm[usable], found.mu_a_per_mm[usable], through_origin=True
            ),
            "albedo": float(np.median(found.albedo[usable])),
            "g_identifiable_rows": int(found.identifiable[:, 2].sum()),
            "status": found.counts(),
        }
    return figures


def others() -> dict[str, object]:
    """TiO2, a polyurethane and an example file: whatever comes."""
    from scenarios.spheres import estimate_rxt

    figures: dict[str, object] = {}
    for name in ("tio2_vis", "vio_A", "AMC"):
        found = estimate_rxt(FOLDER / f"{name}.rxt")
        with np.errstate(invalid="ignore"):
            chi = found.statistics["chi_square"]
        figures[name] = {
            "status": found.counts(),
            "median_mu_a_per_mm": float(np.nanmedian(found.mu_a_per_mm)),
            "median_mu_s_prime_per_mm": float(np.nanmedian(found.mu_s_prime_per_mm)),
            "median_g": float(np.nanmedian(found.g)),
            "max_chi_square": float(np.nanmax(chi)),
        }
    return figures


def run(quick: bool) -> dict[str, object]:
    """Estimate everything and compare.

    Args:
        quick: fewer walks for the lost light, no other g, and neither TiO2 nor the rest.

    Returns:
        median_difference_mu_a, median_difference_mu_s_prime: relative, of the phantom against
        its author's result; the same with the lost light ignored and with other g;
        intralipid_linearity_r2: the lesser of both series, sigma_s against the dilution's step;
        intralipid_residual: the greater relative residual (rms) about the line;
        ink_linearity_r2: mu_a against sigma_t through the origin, the lesser of both series.
    """
    if not FOLDER.is_dir():
        reason = "the measurements of the inverse adding-doubling community are not beside"
        return {"skipped": f"{reason} the repository: expected {'/'.join(FOLDER.parts[-4:])}"}
    started = time.perf_counter()
    figures = phantom(quick)
    dilutions, inks = intralipid(), ink()

    def over(part: dict[str, object], name: str, key: str) -> list[float]:
        return [series[name][key] for series in part.values()]  # type: ignore[index]

    figures["intralipid_linearity_r2"] = min(over(dilutions, "sigma_s_against_step", "r2"))
    figures["intralipid_residual"] = max(
        over(dilutions, "sigma_s_against_step", "rms_relative_residual")
    )
    figures["ink_linearity_r2"] = min(over(inks, "mu_a_against_sigma_t", "r2"))
    figures["intralipid"], figures["ink"] = dilutions, inks
    if not quick:
        figures["others"] = others()
    figures["seconds"] = time.perf_counter() - started
    return figures
