"""The experiment of Iser et al. 2022, section 5.2, as one virtual scenario.

Five PolyJet inks are measured at 0.4 and 0.8 mm on the virtual bench (counts, noise and all) and
estimated. From the estimates a checker of their mixtures, 5 mm thick, is predicted, and compared
with a simulated measurement of it: the Monte Carlo of the true inks in 45:0. As in the
prediction, patches are homogeneous and wide; the printed checker was halftoned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.predict.appearance import Prediction, Slab, monte_carlo_45_0, predict, quantile
from scenarios.predict.colour import (
    Colour,
    Difference,
    ciede2000_of,
    colour_of,
    difference,
)
from scenarios.predict.draws import DEFAULT_DRAWS, medium_of
from scenarios.predict.mixture import UncertainMedium, mix_media, mix_properties
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators import EstimateResult
    from scenarios.console import Console
    from scenarios.scenario import EstimatorChoice, Scenario

INKS = ("cyan", "magenta", "yellow", "black", "white")
THICKNESS_MM = 5.0
QUICK_STEP_NM, QUICK_PATHS, PATHS = 20.0, 1 << 10, 1 << 12


@dataclass(frozen=True)
class Patch:
    """One colour of the checker: a name and the volume fractions of the inks."""

    name: str
    fractions: tuple[float, float, float, float, float]
    """Of cyan, magenta, yellow, black and white; they add up to 1."""

    @property
    def recipe(self) -> str:
        """The fractions in percent: "C 25 Y 25 W 50"."""
        parts = zip("CMYKW", self.fractions, strict=True)
        return " ".join(f"{ink} {100 * share:g}" for ink, share in parts if share > 0)


PATCHES = (
    Patch("cyan", (1, 0, 0, 0, 0)),
    Patch("magenta", (0, 1, 0, 0, 0)),
    Patch("yellow", (0, 0, 1, 0, 0)),
    Patch("black", (0, 0, 0, 1, 0)),
    Patch("white", (0, 0, 0, 0, 1)),
    Patch("light cyan", (0.2, 0, 0, 0, 0.8)),
    Patch("light magenta", (0, 0.2, 0, 0, 0.8)),
    Patch("light yellow", (0, 0, 0.2, 0, 0.8)),
    Patch("dark grey", (0, 0, 0, 0.3, 0.7)),
    Patch("light grey", (0, 0, 0, 0.03, 0.97)),
    Patch("pale cyan", (0.05, 0, 0, 0, 0.95)),
    Patch("pink", (0, 0.05, 0, 0, 0.95)),
    Patch("cream", (0, 0, 0.05, 0, 0.95)),
    Patch("grey", (0, 0, 0, 0.1, 0.9)),
    Patch("brown", (0, 0.15, 0.3, 0.15, 0.4)),
    Patch("green", (0.25, 0, 0.25, 0, 0.5)),
    Patch("red", (0, 0.25, 0.25, 0, 0.5)),
    Patch("blue", (0.25, 0.25, 0, 0, 0.5)),
    Patch("orange", (0, 0.1, 0.4, 0, 0.5)),
    Patch("violet", (0.1, 0.3, 0, 0, 0.6)),
)
"""The built-in checker, row by row of five."""
QUICK_PATCHES = tuple(
    patch
    for patch in PATCHES
    if patch.name in (*INKS, "light cyan", "grey", "green", "red", "blue")
)


@dataclass(frozen=True, eq=False)
class PatchResult:
    """One patch, predicted and simulated.

    Attributes:
        patch: its recipe.
        predicted: from the estimates.
        simulated: the Monte Carlo of the true inks; its draws are its noise.
        predicted_colour: colour of the prediction.
        simulated_colour: colour of the simulated measurement.
        difference: CIEDE2000 between them, with an interval.
        explained: the CIEDE2000 that prediction interval and Monte Carlo noise exceed in one of
            ten cases.
        covered: share of wavelengths at which the simulated value lies in the prediction's 90 %
            interval, the Monte Carlo noise taken into account.
    """

    patch: Patch
    predicted: Prediction
    simulated: Prediction
    predicted_colour: Colour
    simulated_colour: Colour
    difference: Difference
    explained: float
    covered: float


@dataclass(frozen=True, eq=False)
class Checker:
    """The whole experiment.

    Attributes:
        estimates: by ink.
        patches: results.
        slab: thickness, index and background of all patches.
        illuminant: of the colours.
        quick: whether it was the coarse form.
    """

    estimates: dict[str, EstimateResult]
    patches: tuple[PatchResult, ...]
    slab: Slab
    illuminant: str
    quick: bool


def ink_scenario(ink: str, *, quick: bool = False, seed: int = 1) -> Scenario:
    """The visit that measures one ink: between cover glasses, 0.4 and 0.8 mm, 400 to 700 nm."""
    from scenarios.scenario import Scenario, load_scenario
    from twin.toml import validate

    data = load_scenario("polyjet-white").model_dump(mode="python")
    step = QUICK_STEP_NM if quick else 10.0
    data["title"] = f"PolyJet {ink} between cover glasses, 0.4 and 0.8 mm"
    for sample in data["samples"]:
        sample |= {
            "material": f"polyjet_{ink}", "name": f"{ink} {sample['thickness_mm']:g} mm",
        }  # fmt: skip
    data["wavelength"] = {"start_nm": 380.0, "stop_nm": 720.0, "step_nm": step}
    data["bench"]["instrument"] |= {
        "start_nm": 400.0, "stop_nm": 700.0, "step_nm": step, "bandwidth_nm": 5.0,
    }  # fmt: skip
    scenario = validate(data, Scenario).settled(seed=seed, quick=quick)
    return scenario.settled(paths=2 * QUICK_PATHS) if quick else scenario


def run_checker(
    *,
    slab: Slab | None = None,
    illuminant: str = "D65",
    estimator: EstimatorChoice | None = None,
    quick: bool = False,
    seed: int = 1,
    draws: int = DEFAULT_DRAWS,
    work: Path | None = None,
    resume: bool = False,
    cache: Path | None = None,
    threads: int | None = None,
    console: Console | None = None,
) -> Checker:
    """Measure and estimate the inks, predict the checker, simulate it, compare.

    Args:
        slab: of every patch; None is 5 mm of index 1.5 over the bench's black background.
        illuminant: of the colours.
        estimator: None takes the scenario's.
        quick: ten patches, wavelengths every 20 nm, few light paths, a coarse map.
        seed: of every random number.
        draws: of each estimate.
        work: folder in which finished estimates and patches are kept; None keeps none.
        resume: use those that are there and were made in the same way.
        cache: of the appearance maps.
        threads: of the Monte Carlo; the result does not depend on them.
        console: is told what happens.

    Raises:
        InputError: an unknown estimator, illuminant or background, or too little of an ink could
            be estimated to give a colour.
    """
    from scenarios.console import Console
    from scenarios.predict.checker_work import estimated_ink, kept_patch
    from twin.materials import optical_properties

    console = console or Console(quiet=True)
    slab = slab or Slab(THICKNESS_MM, 1.5, "flocked_paper")
    estimates, media = {}, []
    for number, ink in enumerate(INKS):
        scenario = ink_scenario(ink, quick=quick, seed=seed + number)
        if estimator is not None:
            scenario = scenario.model_copy(update={"estimator": estimator})
        estimates[ink] = estimated_ink(
            scenario, ink, work=work, resume=resume, cache=cache, threads=threads, console=console
        )
        media.append(medium_of(estimates[ink], count=draws, seed=seed + number, name=ink))
    wavelength = media[0].wavelength_nm
    true = [_stacked(optical_properties(f"polyjet_{ink}", wavelength)) for ink in INKS]
    chosen = QUICK_PATCHES if quick else PATCHES
    results = []
    with console.step(f"predict and simulate {len(chosen)} patches") as progress:
        for number, patch in enumerate(chosen):
            paths = QUICK_PATHS if quick else PATHS

            def simulate(
                patch: Patch = patch, paths: int = paths, number: int = number
            ) -> tuple[FloatArray, FloatArray]:
                return monte_carlo_45_0(
                    wavelength, mix_properties(true, patch.fractions), slab,
                    paths=paths, seed=seed + 1000 + number, threads=threads,
                )  # fmt: skip

            key = {
                "fractions": patch.fractions, "slab": repr(slab), "paths": paths,
                "seed": seed + 1000 + number, "wavelength_nm": wavelength.tolist(),
            }  # fmt: skip
            value, error = kept_patch(simulate, patch.name, key, work, resume, console)
            mixed = mix_media(media, patch.fractions, name=patch.name)
            results.append(compared(patch, mixed, value, error, slab, illuminant, seed))
            progress(number + 1.0, float(len(chosen)))
    return Checker(estimates, tuple(results), slab, illuminant, quick)


def _stacked(properties: object) -> FloatArray:
    return np.stack(
        [np.asarray(getattr(properties, name)) for name in ("albedo", "sigma_t_per_mm", "g")], -1
    )


def compared(
    patch: Patch,
    mixed: UncertainMedium,
    value: FloatArray,
    error: FloatArray,
    slab: Slab,
    illuminant: str,
    seed: int,
) -> PatchResult:
    """Predict one patch and compare it with its simulated radiance factor.

    Args:
        patch: recipe.
        mixed: medium that the estimates give for it.
        value: simulated radiance factor, shape (W,).
        error: its standard error, shape (W,).
        slab: thickness, index, background.
        illuminant: of the colours.
        seed: of the noise draws.
    """
    predicted = predict(mixed, slab)
    rng = np.random.Generator(np.random.Philox(key=[seed, 2022]))
    noise = error * rng.standard_normal(predicted.draws.shape)
    simulated = Prediction(
        f"{patch.name}, simulated", slab, mixed.wavelength_nm, value, value + noise, error, True
    )
    away = difference(predicted, simulated, illuminant)
    first, second = (
        colour_of(p, illuminant, range_nm=away.range_nm) for p in (predicted, simulated)
    )
    centre = np.array(first.swatch.lab)
    shaken = centre + next(iter(second.lab_draws.values())) - np.array(second.swatch.lab)
    explained = max(
        float(quantile(ciede2000_of(lab, shaken), [0.9])[0]) for lab in first.lab_draws.values()
    )
    low, high = replace(predicted, draws=predicted.draws + noise).interval(0.9)
    known = np.isfinite(predicted.reflectance)
    covered = float(((value >= low) & (value <= high))[known].mean())
    return PatchResult(patch, predicted, simulated, first, second, away, explained, covered)
