"""What a study says: its simulation may confirm the answer, contradict it, or leave it open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.design import Candidate, Goal, load_parts
from scenarios.design.search import Found
from scenarios.design.study import Study
from scenarios.design.verified import Verified
from scenarios.design.wording import headline, input_title, ratios, simulation, verdict
from scenarios.report_design.page import design_page

PARTS = load_parts()
CHEAP = Candidate(
    ("white-leds-2", "printed-panels", "two-holes", "ptfe-sheet", "flocked-paper", "as7341",
     "hand-slide", "ruler-spacers"), (0.3, 1.2),
)  # fmt: skip
DEAR = replace(CHEAP, parts=PARTS.assembly("seed-translucent").parts)
GOAL = Goal.model_validate(
    {
        "title": "a test",
        "materials": [{"name": "resin", "albedo": 0.95, "sigma_t_per_mm": 3.0, "g": 0.7}],
        "targets": {"albedo": 0.01, "g": 0.03},
        "protocol": {"thickness_mm": [0.3, 1.2], "samples": [2]},
    }
)


def simulated(own: Candidate, albedo: float, g: float, ratio: float = 1.0) -> Verified:
    """Eight visits whose errors are `ratio` of the predicted ones, and these figures."""
    sign = np.resize([1.0, -1.0], (1, 8, 1, 1)) * np.ones((1, 8, 5, 3))
    return Verified(
        own, np.ones((1, 5, 3)), ratio * sign, np.ones((1, 8, 5, 3)),
        figures={"albedo": (albedo, 0.001), "g": (g, 0.002)},
    )  # fmt: skip


def study(*verified: Verified, score: float = 0.9) -> Study:
    """A cheap candidate with this score, and the seed's, which is better."""
    candidates = (CHEAP, DEAR)
    figures = np.array([[0.01 * score, 0.03 * score], [0.004, 0.012]])
    found = Found(
        candidates, figures, np.array([each.price(PARTS) for each in candidates]),
        (figures / GOAL.targets.values).max(axis=1), "exhaustive", True,
    )  # fmt: skip
    limits = {name: {"thickness_mm": 0.7, "width of the bands": 0.3} for name in ("albedo", "g")}
    return Study(GOAL, PARTS, found, (), limits, verified)


@pytest.mark.parametrize(
    ("albedo", "g", "state", "said"),
    [
        (0.009, 0.028, "yes", "confirms that the targets are met"),
        (0.009, 0.033, "open", "leaves open whether the targets are met"),
        (0.009, 0.035, "no", "does not confirm that the targets are met"),
        (0.013, 0.028, "no", "does not confirm that the targets are met"),
    ],
)
def test_the_verdict_says_what_the_simulation_says(
    albedo: float, g: float, state: str, said: str
) -> None:
    found = study(simulated(CHEAP, albedo, g), simulated(DEAR, 0.004, 0.012))
    assert found.meets_in_simulation == state
    assert f"{said}: albedo {albedo:.2g} ± 0.001 (target 0.01)" in simulation(found)
    assert said in verdict(found)
    assert said in design_page(found)
    # a dearer one is named where the answer fails, and only there
    assert (
        "The cheapest simulated candidate that meets them costs 2626 USD" in verdict(found)
    ) == (state == "no")
    tone = 'class="verdict good"' in design_page(found)
    assert tone == (state == "yes")


def test_ratios_out_of_agreement_are_said() -> None:
    off = study(simulated(CHEAP, 0.009, 0.028, ratio=1.6))
    assert "Actual errors are 1.6 (albedo), 1.6 (σt), 1.6 (g) times the predicted" in verdict(off)
    assert ratios(off.verified[0]) == "1.6 (albedo), 1.6 (σt), 1.6 (g)"
    assert not off.verified[0].agrees
    assert "times the predicted" not in verdict(study(simulated(CHEAP, 0.009, 0.028, ratio=1.1)))


def test_what_was_not_simulated_is_said_to_be_a_prediction() -> None:
    alone, other = study(), study(simulated(DEAR, 0.004, 0.012))
    for each in (alone, other):
        assert each.meets_in_simulation == "not simulated"
        assert "this is a prediction alone" in verdict(each)
    failed = study(replace(simulated(CHEAP, 0.0, 0.0), failure="no light"))
    assert failed.meets_in_simulation == "failed"
    assert "Its simulation failed: no light." in verdict(failed)
    assert "no light" in design_page(failed)


def test_impossible_targets_say_the_best_and_what_limits_it() -> None:
    found = study(simulated(DEAR, 0.03, 0.02), score=9.0)
    worse = replace(found, found=replace(found.found, figures=9.0 * found.found.figures,
                                         score=9.0 * found.found.score))  # fmt: skip
    said = headline(worse)
    assert said.startswith("No candidate meets all targets.")
    assert "albedo 0.036 (target 0.01), g 0.108 (target 0.03), for 2626 USD" in said
    assert "thickness of the samples, 70 % of its variance" in said
    assert 'class="verdict poor"' in design_page(worse)


def test_inputs_have_names_that_a_person_reads() -> None:
    assert input_title("thickness_mm") == "thickness of the samples"
    assert input_title("width of the bands") == "width of the bands"
    assert input_title("gain_step") != "gain_step"
