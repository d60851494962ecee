"""What a design study found, in words: figures, inputs, set-ups, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from scenarios.design.candidate import Candidate
from scenarios.design.modes import effect_parameter
from scenarios.design.parts import Parts
from scenarios.design.verified import PARAMETERS, Verified
from twin.errors import InputError

if TYPE_CHECKING:
    from scenarios.design.study import Study

FIGURES: Mapping[str, str] = MappingProxyType(
    {
        "albedo": "albedo",
        "sigma_t_relative": "σt, relative",
        "g": "g",
        "de2000": "CIEDE2000 of a slab",
        "fluorescence_rmse": "RMSE of fluorescence",
        "fluorescence_de2000": "CIEDE2000 of fluorescence",
    }
)
"""What targets are called."""
_INPUTS: Mapping[str, str] = MappingProxyType(
    {
        "thickness_mm": "thickness of the samples",
        "thickness_relative": "thickness of the samples (share)",
        "n": "refractive index",
        "rho_black_relative": "reflectance of the black",
        "rho_white_relative": "reflectance of the white",
        "acceptance_relative": "angle of the view",
    }
)


def input_title(name: str) -> str:
    """An input of the budget or an effect in plain words; what is neither, as it is."""
    if name in _INPUTS:
        return _INPUTS[name]
    try:
        return effect_parameter(name)[0].title
    except InputError:
        return name


def made_of(candidate: Candidate, parts: Parts) -> str:
    """Titles of the parts, and the protocol."""
    steps = [part.title for part in candidate.chosen(parts)]
    if candidate.thickness_mm:
        mm = " and ".join(f"{each:g}" for each in candidate.thickness_mm)
        steps.append(f"samples of {mm} mm")
    if candidate.leds:
        steps.append(f"{candidate.leds} lights")
    steps.append(f"{candidate.repeats} shots of {candidate.averages} frames")
    if candidate.thickness_mm:
        steps.append(f"view of ±{candidate.acceptance_deg:g}°, panels at {candidate.polar_deg:g}°")
    return "; ".join(steps)


def headline(study: Study) -> str:
    """What was found, by prediction."""
    number, found, targets = study.answer, study.found, study.goal.targets
    price = f"{found.price_usd[number]:g} USD"
    if study.reached:
        how = "of all candidates" if found.complete else "of those looked at"
        return f"{price}: the cheapest {how} that is predicted to meet all targets."
    figures = found.figures[number]
    worst = targets.names[int(np.argmax(figures / targets.values))]
    cause, share = next(iter(study.limits[worst].items()), ("", 0.0))
    best = ", ".join(
        f"{FIGURES[name]} {value:.3g} (target {target:g})"
        for name, value, target in zip(targets.names, figures, targets.values, strict=True)
    )
    return (
        f"No candidate meets all targets. The best that is reachable: {best}, for {price}."
        f" What limits {FIGURES[worst]}: {input_title(cause)}, {100 * share:.0f} % of its variance."
    )


def simulation(study: Study) -> str:
    """What the simulation of the answer says of it."""
    own, state = study.simulated_answer, study.meets_in_simulation
    if own is None:
        return "It was not simulated: this is a prediction alone."
    if own.failure:
        return f"Its simulation failed: {own.failure}."
    figures = ", ".join(
        f"{FIGURES[name]} {value:.2g} ± {error:.1g} (target {getattr(study.goal.targets, name):g})"
        for name, (value, error) in own.figures.items()
    )
    said = {
        "yes": "Its simulation confirms that the targets are met",
        "no": "Its simulation does not confirm that the targets are met",
        "open": "Its simulation leaves open whether the targets are met",
    }
    # without a figure of its own (de2000) a simulation says how good the prediction is, no more
    text = f"{said[state]}: {figures}." if own.figures and study.reached else ""
    if not own.agrees:
        text += f" Actual errors are {ratios(own)} times the predicted ones."
    cheapest = study.confirmed
    if study.reached and state == "no" and cheapest is not None:
        text += (
            f" The cheapest simulated candidate that meets them costs"
            f" {cheapest.candidate.price(study.parts):g} USD"
            f" ({cheapest.candidate.id(study.parts)})."
        )
    return text.strip()


def ratios(each: Verified) -> str:
    """Actual over predicted errors, such as "1.6 (albedo), 2.1 (σt), 2.8 (g)"."""
    names = {"sigma_t_per_mm": "σt"}
    return ", ".join(
        f"{ratio:.2g} ({names.get(name, name)})"
        for name, ratio in zip(PARAMETERS, each.ratio, strict=True)
    )


def verdict(study: Study) -> str:
    """The answer, what its simulation says, and what it is made of."""
    own = study.found.candidates[study.answer]
    said = [headline(study), simulation(study), f"Made of: {made_of(own, study.parts)}."]
    return " ".join(each for each in said if each)
