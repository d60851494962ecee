"""Effects that are true and not told: what they cost, what a visit cannot hold, zero is nothing."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.stress import Case, Outcome, load_plan, run_plan
from scenarios.stress.cost import Cost, costs_of
from scenarios.stress.effects import cases_of, check_effects, world_of
from scenarios.stress.light import FIELDS
from scenarios.stress.plan import Light, StressPlan
from scenarios.stress.simulate import visit_bench, visit_wavelengths
from scenarios.stress.tables import write_outcome
from scenarios.stress.world_light import sample_light
from tests.stress.tiny import tiny, tiny_plan, write
from twin.effects import world_captures
from twin.errors import InputError
from twin.materials import OpticalProperties
from twin.transport import NoiselessCaptures

THICK = {"thickness[0.4 mm]": 0.05}
ENTRIES: dict[str, Any] = {
    "thick": THICK,
    "not at all": {"thickness[0.4 mm]": 0.0, "dark_offset": 0.0, "drift[black]": {"tilt": 0.0}},
}
NOISY = 30.0
CASE = Case("bench", 1.0, "beer")


def effects_plan(**changes: Any) -> StressPlan:
    table = {
        "points": 48,
        "points_per_visit": 24,
        # Beer's law is right where little is scattered into the detector.
        "materials": {"albedo": [0.1, 0.7], "sigma_t_per_mm": [0.5, 4.0], "g": [0.0, 0.3]},
        "effects": ENTRIES,
    }
    return tiny_plan(**(table | changes))


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, cache: Path) -> tuple[Outcome, Path]:
    folder = tmp_path_factory.mktemp("effects")
    outcome = run_plan(effects_plan(), folder, cache=cache)
    write_outcome(outcome, folder, "tiny")
    return outcome, folder


def cost(outcome: Outcome, effects: str, noise: float = 1.0) -> Cost:
    from scenarios.stress.tables import scores_of

    wanted = CASE._replace(effects=effects, noise=noise)
    return next(c for c in costs_of(outcome, scores_of(outcome)) if c.case == wanted)


def test_a_thickness_that_is_not_told_is_a_bias_of_sigma_t(run: tuple[Outcome, Path]):
    outcome, _ = run
    thick, none = (
        outcome.answers[CASE._replace(effects=name)].value[:, 1] for name in ("thick", "none")
    )
    assert np.abs(np.median(thick / none) - 1.05) < 0.002
    found = cost(outcome, "thick").parameters["sigma_t_per_mm"]
    assert found.moved > 3.0
    assert found.bias > 2.0
    assert found.coverage_none.value > 0.75
    assert found.coverage.value < 0.25
    assert found.lost > 0.5


def test_much_noise_hides_it(tmp_path: Path, cache: Path):
    plan = effects_plan(noise=[NOISY], effects={"thick": {"thickness[0.4 mm]": 0.01}})
    found = cost(run_plan(plan, tmp_path, cache=cache), "thick", NOISY)
    assert 0.0 < found.parameters["sigma_t_per_mm"].moved < 0.5
    assert abs(found.parameters["sigma_t_per_mm"].lost) < 0.1


def test_effects_without_size_change_not_a_bit(run: tuple[Outcome, Path]):
    outcome, _ = run
    zero, none = (outcome.answers[CASE._replace(effects=name)] for name in ("not at all", "none"))
    assert zero.value.tobytes() == none.value.tobytes()
    assert zero.interval.tobytes() == none.interval.tobytes()
    assert cost(outcome, "not at all").error_growth == 1.0
    assert cost(outcome, "thick").error_growth > 3.0


def test_other_effects_beside_them_leave_the_case_without_any_as_it_was(
    tmp_path: Path, cache: Path, run: tuple[Outcome, Path]
):
    alone = run_plan(effects_plan(effects={}), tmp_path, cache=cache)
    assert list(alone.answers) == [CASE]
    for case, answers in alone.answers.items():
        assert answers.value.tobytes() == run[0].answers[case].value.tobytes()


def test_every_file_names_the_entry(run: tuple[Outcome, Path]):
    outcome, folder = run
    names = set(cases_of(outcome.plan))
    rows = list(csv.DictReader((folder / "points.csv").open()))
    assert {row["effects"] for row in rows} == names
    assert len(rows) == 48 * 3
    scores = json.loads((folder / "scores.json").read_text())
    assert {world["effects"] for world in scores["worlds"]} == names
    assert {each["effects"] for each in scores["effects"]} == names - {"none"}
    assert json.loads((folder / "plan.json").read_text())["effects"] == ENTRIES
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<h2>What effects cost") == 1
    assert "not at all" in page
    assert "<image" not in page
    assert outcome.plan.settled().effects == ENTRIES


def test_plans_without_effects_are_written_as_before():
    assert "effects" not in tiny_plan().model_dump(mode="json")
    assert tiny_plan().settled() == tiny_plan()


CONTRAST = {"depth_contrast[absorption]": 0.9}
MATERIAL = np.array([[0.6, 2.0, 0.2], [0.9, 2.0, 0.2], [0.8, 5.0, 0.5]])


@pytest.mark.parametrize(
    "entry",
    [
        {"wedge[0.4 mm]": 0.15},
        {"extra_covers": 0.5, "phase_function": 0.2},
        {"gloss[white]": 0.5, "gap": 3.0, "aperture": 4.0},
        CONTRAST,
    ],
    ids=lambda entry: next(iter(entry)),
)
def test_the_light_of_an_effect_is_that_of_the_twin(entry: dict[str, Any]):
    plan = tiny_plan(effects={"it": entry}, light={"relative_error": 0.006, "most_paths": 1 << 15})
    bench = visit_bench(plan.benches["bench"], len(MATERIAL))
    wavelength = visit_wavelengths(bench)
    world = world_of(plan, bench, "it")

    def lit(name: str, seed: int = 3) -> NoiselessCaptures:
        own = world_of(plan, bench, name)
        return sample_light(own, 0, wavelength, MATERIAL, plan.light, seed=seed)

    albedo, sigma_t, g = MATERIAL.T
    medium = OpticalProperties(wavelength, albedo, sigma_t, g, None)
    (twin,) = world_captures(world, wavelength, properties=medium, paths=1 << 15, seeds=[8])
    assert worst(lit("it"), twin) < 4.5
    # The check can fail: without the effect it is other light.
    assert worst(lit("none"), twin) > 4.5


def worst(one: NoiselessCaptures, other: NoiselessCaptures) -> float:
    """Greatest difference in combined standard errors."""
    found = [
        np.abs(getattr(one, name) - getattr(other, name))
        / np.hypot(getattr(one, f"{name}_se"), getattr(other, f"{name}_se")).clip(1e-9)
        for name in FIELDS[:3]
    ]
    return float(np.max(found))


def test_layered_light_is_kept_in_the_cache(tmp_path: Path):
    plan = tiny_plan(effects={"it": CONTRAST})
    bench = visit_bench(plan.benches["bench"], 3)
    world, coarse = world_of(plan, bench, "it"), Light(relative_error=0.1, most_paths=1 << 12)

    def lit(folder: Path | None) -> np.ndarray:
        found = sample_light(
            world, 0, visit_wavelengths(bench), MATERIAL, coarse, seed=3, folder=folder
        )
        return np.stack([getattr(found, name) for name in FIELDS])

    first = lit(tmp_path)
    assert len(list(tmp_path.iterdir())) == 1
    assert lit(tmp_path).tobytes() == first.tobytes() == lit(None).tobytes()


@pytest.mark.parametrize(
    ("entry", "place", "words"),
    [
        ({"thicknes[0.4 mm]": 0.1}, "effects.bad", "Did you mean `thickness`?"),
        ({"thickness[0.5 mm]": 0.1}, "effects.bad", "Did you mean `thickness[0.4 mm]`?"),
        ({"thickness": 0.1}, "effects.bad", "one of thickness[0.4 mm]"),
        ({"gap": -1.0}, "effects.bad.gap.gap_mm", "at least 0 mm"),
        ({"thickness[0.4 mm]": 2.0}, "effects.bad.thickness[0.4 mm].relative", "within 0.9"),
        ({"drift[black]": 0.01}, "effects.bad.drift[black]", "{ level = ..., tilt = ... }"),
        ({"drift[black]": {"levle": 0.1}}, "effects.bad.drift[black]", "Did you mean `level`?"),
        ({"wavelength_shift[all]": 1.0}, "effects.bad", "shifts wavelengths"),
        ({"bandwidth": 2.0}, "effects.bad", "pixels see their own wavelength alone"),
        ({"stray_light": 0.01}, "effects.bad", "materials.spectra = true"),
        ({"fluorescence": 0.01}, "effects.bad", "materials.spectra = true"),
        ({"cross_talk": 0.01}, "effects.bad", "fluorescence visits"),
        ({"wedge[0.4 mm]": 1.0}, "effects.bad.wedge[0.4 mm]", "leaves some thickness"),
        ({"phase_function": 0.9}, "effects.bad.second_share", "smaller share"),
        ({}, "effects", "one effect or more"),
    ],
)
def test_an_effect_that_cannot_be_is_refused_with_its_name(
    tmp_path: Path, entry: dict[str, Any], place: str, words: str
):
    path = write(tmp_path / "plan.toml", tiny(effects={"bad": entry}))
    with pytest.raises(InputError) as caught:
        load_plan(path)
    assert caught.value.place == place
    assert str(path) in caught.value.file
    assert words in str(caught.value)


def test_a_name_that_is_taken_is_refused():
    with pytest.raises(InputError, match="another name"):
        tiny_plan(effects={"none": THICK})


def test_an_effect_of_one_bench_alone_names_the_bench():
    plan = tiny_plan(
        effects={"bare": {"missing_covers": 1.0}},
        benches={"a": {}, "b": {"covers_above": [], "covers_below": []}},
    )
    with pytest.raises(InputError, match=r"effects\.bare.*on the bench 'b'"):
        check_effects(plan)


def test_a_spectrum_holds_effects_that_mix_wavelengths():
    entry = {"stray_light": 0.01, "fluorescence": 0.02}
    check_effects(tiny_plan(effects={"it": entry}, materials={"spectra": True}))
