"""Diagnosis of fluorescence visits: simulated benches with and without something wrong."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis import Diagnosis, diagnose
from diagnosis.fluorescence import (
    FluorescenceCase,
    diagnose_fluorescence,
    diagnosed_fluorescence,
    fluorescence_case,
)
from diagnosis.fluorescence_model import TWIN, FluorescenceBench, readings
from diagnosis.reduction import Reduction
from tests.diagnosis.fluorescence_visits import Disturbance, visit
from twin.effects import Effect, EffectParameter, catalogue
from twin.effects.catalogue.fluorescence_bench import FluorescenceWorld
from twin.fluorescence import DonaldsonMatrix, corrected, example, named_setup


def diagnosed(
    setup: str, material: str, seed: int, *disturbances: Disturbance
) -> tuple[FluorescenceCase, Diagnosis]:
    own = named_setup(setup)
    matrix = example(material, own.emission_nm, own.excitation_nm)
    return diagnosed_fluorescence(visit(own, matrix, seed, disturbances))


@pytest.mark.parametrize(
    ("setup", "material"),
    [
        ("l1-s1", "yellow_highlighter"), ("l1-s2", "pink_paper"), ("l2-s1", "green_and_red"),
        ("l2-s2", "red_ink"),
    ],
)  # fmt: skip
def test_nothing_wrong_is_no_gap(setup: str, material: str) -> None:
    case, found = diagnosed(setup, material, 11)
    assert found.verdict == "no_gap", found.reason
    truth = case.readings.data.truth
    assert truth is not None
    below = np.tril(np.ones(truth.matrix.shape, bool), -1)
    assert np.sqrt(np.mean((case.matrix().matrix - truth.matrix)[below] ** 2)) < 5e-3


@pytest.mark.parametrize(
    ("setup", "material", "effect", "number", "value", "slack"),
    [
        ("l2-s2", "pink_paper", "filter_leak", 3, 0.02, 0.001),
        ("l1-s2", "green_marker", "cross_talk", 0, 0.03, 0.001),
        ("l1-s2", "brightened_paper", "sensitivity_error", 3, -2.0, 0.1),
        ("l2-s1", "red_ink", "illuminant_shift", 2, 2.0, 0.3),
    ],
)
def test_an_effect_is_named_with_its_value(
    setup: str, material: str, effect: str, number: int, value: float, slack: float
) -> None:
    case, found = diagnosed(setup, material, 21, (effect, number, value))
    instance = "all" if number < 0 else f"illuminant {number + 1}"
    if effect == "sensitivity_error":
        instance = f"channel {number + 1}"
    name = "cross_talk" if effect == "cross_talk" else f"{effect}[{instance}]"
    assert found.leading == (name,), (found.verdict, found.leading)
    assert found.verdict in ("effect", "group")
    own = next(each for each in found.effects if each.name == name)
    assert own.parameters[0].value == pytest.approx(value, abs=slack)
    assert found.closure is not None
    assert found.closure.value > 0.9
    # The matrix under the effect is nearer to the truth than without.
    truth = case.readings.data.truth
    assert truth is not None
    assert found.best is not None
    plain, better = (
        np.abs(case.matrix(values).matrix - truth.matrix).sum()
        for values in (None, found.best.values)
    )
    assert better < plain


def test_signatures_are_what_effects_do_to_expected_readings() -> None:
    setup = named_setup("l1-s2")
    case = fluorescence_case(visit(setup, example("pink_paper"), 3))
    twin = case.twin

    def expected(values: dict[str, np.ndarray]) -> np.ndarray:
        return twin.spread(twin.unknowns.expected(twin.lit(values), twin.point))

    for candidate, own in zip(case.problem.candidates, case.problem.columns, strict=True):
        for index, column in enumerate(own):
            step = np.zeros(candidate.size)
            step[index] = 0.3 * candidate.prior_scale[index]
            back = 0.0 * step if candidate.sign[index] else -step
            change = expected({candidate.name: step}) - expected({candidate.name: back})
            linear = case.problem.signatures[column] * (step - back)[index]
            assert np.abs(change - linear).max() < 0.1 * np.abs(linear).max(), candidate.name


def test_levels_of_lights_and_gains_of_a_chip_are_no_gap() -> None:
    """They are what the white is for: a control that the white alone fixes them."""
    setup = named_setup("l1-s2")
    own = visit(setup, example("pink_paper"), 4)
    case = fluorescence_case(own)
    reduction = case.problem
    assert case.readings.captures == ("white", "sample")
    changed = case.readings.value.copy()
    changed[:, 2] *= 1.05
    reduced = Reduction.of(reduction, reduction.jacobian(reduction.material, {}))
    common = case.twin.spread(changed - case.readings.value)
    one = changed - case.readings.value
    one[0] = 0.0
    alone = case.twin.spread(one)
    assert np.linalg.norm(reduced(common)) < 0.05 * np.linalg.norm(reduced(alone))


def test_a_spectrometer_calibrates_lights_away_and_says_so() -> None:
    case = fluorescence_case(visit(named_setup("l1-s1"), example("pink_paper"), 5))
    assert case.readings.captures == ("sample",)
    assert any("between white and sample" in reason for reason in case.reasons)
    seen = {each.name for each in case.suspects}
    assert "sensitivity_error[all]" in seen
    assert "illuminant_shift[all]" in seen


def test_fine_lights_add_up_to_the_calibrated_ones() -> None:
    setup = named_setup("l2-s2")
    data = readings(visit(setup, example("red_ink"), 6))
    world = FluorescenceBench(setup, data).world
    binned = world.illuminants.reshape(len(world.illuminants), 31, -1).sum(axis=2)
    assert np.allclose(binned, data.data.illuminants, atol=2e-3)
    # The twin's own error is part of every variance.
    assert np.all(data.variance >= (TWIN * data.value) ** 2)


def test_a_white_that_looks_fluorescent_is_diagnosed_though_estimators_refuse_it() -> None:
    setup = named_setup("l1-s2")
    own = visit(setup, example("green_marker"), 21, [("cross_talk", 0, 0.03)])
    with pytest.raises(ValueError, match="without fluorescence"):
        corrected(own)
    case = fluorescence_case(own)
    assert any("which it may be" in reason for reason in case.reasons)


def test_a_broken_entry_is_named_and_left_out() -> None:
    def change(world: FluorescenceWorld, values: object, instance: str) -> FluorescenceWorld:
        raise RuntimeError("lamp fell down")

    broken = Effect(
        "fallen_lamp", "fluorescence", "a lamp fell down", "It falls.", "none",
        (EffectParameter("height", "m", 0.0, 1.0),), "signal", change, visit="fluorescence",
    )  # fmt: skip
    said: list[str] = []
    effects = catalogue().with_effects([broken])
    own = visit(named_setup("l1-s2"), example("white"), 7)
    case = fluorescence_case(own, effects=effects, say=said.append)
    assert any("fallen_lamp" in words and "lamp fell down" in words for words in said)
    assert "fallen_lamp" not in {each.name for each in case.suspects}


def test_same_seed_same_diagnosis() -> None:
    own = visit(named_setup("l1-s2"), example("pink_paper"), 8)
    first, second = (diagnose_fluorescence(own, seed=1) for _ in range(2))
    assert first.as_json() == second.as_json()


def test_a_gap_shows_though_its_effect_is_not_in_the_catalogue() -> None:
    own = visit(named_setup("l1-s2"), example("pink_paper"), 8, [("illuminant_shift", 2, 2.0)])
    case = fluorescence_case(own, effects=catalogue().without(["illuminant_shift"]))
    found = diagnose(case.problem)
    assert found.verdict == "none_of_these"
    assert not any(name.startswith("illuminant_shift") for name in found.names)


@pytest.mark.parametrize("setup", ["l1-s1", "l2-s1"])
def test_a_material_that_is_not_smooth_is_no_gap(setup: str) -> None:
    """Rows of measured matrices are off by a per cent, their cells by a thousandth."""
    own = named_setup(setup)
    smooth = example("pink_paper", own.emission_nm, own.excitation_nm)
    random = np.random.Generator(np.random.Philox(key=5))
    matrix = smooth.matrix * (1.0 + 0.01 * random.standard_normal((31, 1)))
    rough = np.maximum(matrix + 1e-3 * random.standard_normal(matrix.shape), 0.0)
    matrix = np.where(np.tril(np.ones(matrix.shape, dtype=bool), -1), rough, matrix)
    material = DonaldsonMatrix(matrix, smooth.emission_nm, smooth.excitation_nm, name="rough")
    found = diagnosed_fluorescence(visit(own, material, 7))[1]
    assert found.verdict == "no_gap", (found.verdict, found.leading)
