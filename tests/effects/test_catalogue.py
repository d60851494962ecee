"""The catalogue: complete, pure, exact at nothing, and open to others."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.effects.worlds import WAVELENGTH, candidates, engine, material, sharp, typical, world
from twin.bench import Bench, Sample
from twin.effects import (
    Candidate,
    Effect,
    EffectEngine,
    World,
    accept,
    candidate,
    catalogue,
    expected_intensities,
    registry,
)
from twin.errors import InputError

TABLE = {
    "source": {
        "drift", "panel_angle", "panel_distance", "reference_plane", "panel_gradient",
        "ambient_light", "beam_divergence", "beam_tilt",
    },
    "sample": {
        "thickness", "refractive_index", "wedge", "roughness", "extra_covers", "missing_covers",
        "lateral_loss", "off_centre", "depth_contrast", "phase_function", "fluorescence",
    },
    "background": {"black_level", "black_red", "white_ageing", "gloss", "gap"},
    "detector": {
        "aperture", "dark_offset", "stray_light", "nonlinearity", "wavelength_shift", "bandwidth",
        "gain_step",
    },
    "fluorescence": {
        "illuminant_shift", "ultraviolet_leak", "filter_leak", "cross_talk", "sensitivity_error",
    },
}  # fmt: skip
"""The table of the catalogue, place by place."""
NAMES = tuple(candidates())


def test_every_row_of_the_table_is_there() -> None:
    found: dict[str, set[str]] = {}
    for effect in catalogue().effects:
        found.setdefault(effect.place, set()).add(effect.name)
    assert found == TABLE


def test_every_entry_says_what_it_is() -> None:
    for effect in catalogue().effects:
        assert effect.title
        assert len(effect.physics) > 60
        assert re.search(r"(\d{4}|\.md|twin\.|first order)", effect.source), effect.name
        for parameter in effect.parameters:
            assert parameter.prior_scale > 0.0
            assert parameter.unit
            assert parameter.description
            assert parameter.limit >= parameter.prior_scale


@pytest.mark.parametrize("name", NAMES)
def test_nominal_values_change_nothing(name: str) -> None:
    own = candidates()[name]
    assert own.apply(world(), own.nominal) is world()
    light = np.full((len(WAVELENGTH), 2, 3), 0.3)
    assert np.array_equal(expected_intensities(sharp(), light, WAVELENGTH), light)


@pytest.mark.parametrize("name", NAMES)
def test_applying_is_pure_and_recorded(name: str) -> None:
    own = candidates()[name]
    before = World.nominal(Bench(), world().samples)
    bench = before.bench.model_dump()
    after = own.apply(before, typical(own))
    assert before == World.nominal(Bench(), world().samples)
    assert before.bench.model_dump() == bench
    assert (after.described_bench, after.described_samples) == (before.bench, before.samples)
    assert replace(after, applied=()) != before, "the effect did nothing"
    assert [(each.name, each.values) for each in after.applied] == [(name, typical(own))]
    assert own.apply(before, typical(own)) == after


@settings(deadline=None, derandomize=True, max_examples=40)
@given(st.sampled_from(NAMES), st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=2))
def test_values_inside_a_range_apply_and_others_are_refused(name: str, x: list[float]) -> None:
    own = candidates()[name]
    values = {
        p.name: p.nominal + p.prior_scale * share
        for p, share in zip(own.parameters, x, strict=False)
    }
    wrong = [
        p
        for p, share in zip(own.parameters, x, strict=False)
        if (p.sign == "positive" and share < 0) or (p.sign == "negative" and share > 0)
    ]
    if wrong:
        with pytest.raises(InputError, match=r"at least|at most"):
            own.apply(world(), values)
    else:
        after = own.apply(world(), values)
        assert after.described_bench == world().described_bench
    far = {own.parameters[0].name: 1e9}
    with pytest.raises(InputError, match="within"):
        own.apply(world(), far)


def test_wrong_values_are_answered() -> None:
    own = candidates()["gap"]
    with pytest.raises(InputError, match="gap_mm"):
        own.apply(world(), {"gap": 1.0})
    with pytest.raises(InputError, match="2 values"):
        own.apply(world(), (1.0, 2.0))
    with pytest.raises(InputError, match="nan"):
        own.apply(world(), (float("nan"),))


def test_candidates_are_found_by_name() -> None:
    assert candidate(world(), "thickness[0.3 mm]").instance == "0.3 mm"
    with pytest.raises(InputError, match=r"Did you mean .*thickness"):
        candidate(world(), "thicknes")
    with pytest.raises(InputError, match=r"thickness\[0.6 mm\]"):
        candidate(world(), "thickness[9 mm]")


def test_equal_thicknesses_are_called_by_name() -> None:
    pair = (Sample(name="a", thickness_mm=0.5), Sample(name="b", thickness_mm=0.5))
    assert World.nominal(Bench(), pair).sample_keys == ("a", "b")


def test_any_set_of_effects_combines(tmp_path: Path) -> None:
    names = ("gap", "thickness[0.3 mm]", "drift[black]", "wedge[0.6 mm]", "black_level", "aperture")
    both = world()
    for name in names:
        both = candidates()[name].apply(both, typical(candidates()[name]))
    backwards = world()
    for name in reversed(names):
        backwards = candidates()[name].apply(backwards, typical(candidates()[name]))
    assert replace(both, applied=()) == replace(backwards, applied=())
    own = EffectEngine(world(), WAVELENGTH, least_paths=256, folder=tmp_path)
    light = own.intensities(both, material())
    assert np.isfinite(light).all()
    assert not np.allclose(light, own.intensities(world(), material()), rtol=1e-3)


def test_accepted_effects_describe_the_world() -> None:
    bench, own = Bench(), world().samples
    gap, drift = candidates()["gap"], candidates()["drift[black]"]
    thicker = candidates()["thickness[0.6 mm]"]
    bench, own = accept(bench, own, gap, (0.25,))
    bench, own = accept(bench, own, drift, (0.01, 0.0), (0.002, 0.001))
    bench, own = accept(bench, own, thicker, (0.05,))
    assert bench.background.gap_mm == 0.75
    assert own[1].thickness_mm == pytest.approx(0.63)
    assert bench.effects[0].uncertainty == (0.002, 0.001)
    again = World.nominal(Bench.model_validate(bench.model_dump(mode="json")), own)
    assert [each.name for each in again.applied] == ["drift[black]"]
    assert again.steps
    assert again.bench.effects == ()
    kept, _ = accept(Bench(), world().samples, gap, (0.25,), (0.1,), plain=False)
    assert kept.background.gap_mm == 0.5
    assert World.nominal(kept, world().samples).bench.background.gap_mm == 0.75


def test_a_bench_without_effects_is_written_as_before() -> None:
    assert "effects" not in Bench().model_dump()


class _Point:
    """An entry point as another package would announce it."""

    def __init__(self, name: str, found: object) -> None:
        self.name, self.value, self._found = name, f"mine.{name}:EFFECT", found

    def load(self) -> object:
        if isinstance(self._found, Exception):
            raise self._found
        return self._found


def test_broken_entries_are_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def raises(world: World) -> tuple[str, ...]:
        raise ZeroDivisionError("no such place")

    good = replace(candidates()["gap"].effect, name="good")
    points = [
        _Point("good", good),
        _Point("raises", replace(good, name="raises", instances=raises)),
        _Point("gone", ImportError("no module")),
        _Point("number", 3),
        _Point("gap", good),
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    found, left_out = catalogue().candidates(world())
    assert "good" in {each.name for each in found}
    assert {each.name for each in left_out} == {"raises", "gone", "number", "gap"}
    said = {each.name: each.reason for each in left_out}
    assert "no such place" in said["raises"]
    assert "no module" in said["gone"]
    assert "expected a twin.effects.Effect" in said["number"]
    assert len(found) == len(NAMES) + 1


def test_effects_that_raise_or_answer_nan_are_left_out() -> None:
    def nan(world: World, values: Mapping[str, float], instance: str) -> World:
        return world.with_step(lambda rates: rates.scaled((3,), float("nan")))

    def raises(world: World, values: Mapping[str, float], instance: str) -> World:
        raise KeyError("nothing here")

    drift = candidates()["ambient_light"]
    broken = [
        Candidate(replace(drift.effect, name=name, change=change))
        for name, change in (("nan", nan), ("raises", raises))
    ]
    found, left_out = engine().signatures([*broken, drift], material())
    assert set(found) == {"ambient_light"}
    said = {each.name: each.reason for each in left_out}
    assert set(said) == {"nan", "raises"}
    assert "nothing here" in said["raises"]


def test_an_effect_can_be_taken_out() -> None:
    less = catalogue().without(["gap", "drift"])
    assert not {"gap", "drift"} & set(less.names)
    assert len(less.names) == len(catalogue().names) - 2
    with pytest.raises(InputError):
        catalogue().without(["gab"])


def test_the_documented_effect_of_a_user_runs() -> None:
    page = Path("docs/effects.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(# tarnish\.py\n.*?)```", page, re.DOTALL)
    assert code is not None
    scope: dict[str, object] = {}
    exec(compile(code.group(1), "docs/effects.md", "exec"), scope)  # noqa: S102 - our own page
    effect = scope["EFFECT"]
    assert isinstance(effect, Effect)
    own = catalogue().with_effects([effect]).effect("tarnish").candidates(world())[0]
    change = engine().signature(own, material())[0]
    assert change.shape == (len(WAVELENGTH), 2, 3)
    assert np.allclose(change[..., 2], 0.0, atol=1e-9)
    assert change[0, 0, 1] > 0.0, "a tarnished reference makes samples look brighter"


def test_the_page_lists_every_effect_with_its_numbers() -> None:
    page = Path("docs/effects.md").read_text(encoding="utf-8")
    for effect in catalogue().effects:
        for parameter in effect.parameters:
            row = rf"\| `{effect.name}` \|[^\n]*`{parameter.name}` \[{re.escape(parameter.unit)}\]"
            assert re.search(row + rf" {parameter.prior_scale:g}\b", page), effect.name
