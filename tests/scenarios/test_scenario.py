"""Scenario files: the built-in ones, settling, and any text at all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios import Scenario, builtin_names, load_scenario
from scenarios.scenario import WavelengthGrid
from tests.scenarios.tiny import tiny, write
from twin.errors import InputError
from twin.instrument import fine_grid_nm


@pytest.mark.parametrize("name", builtin_names())
def test_a_built_in_scenario_can_be_simulated(name: str):
    scenario = load_scenario(name)
    seen = fine_grid_nm(scenario.bench.instrument)
    assert scenario.wavelength.start_nm <= seen[0]
    assert scenario.wavelength.stop_nm >= seen[-1]
    assert len({sample.thickness_mm for sample in scenario.samples}) >= 2


def test_the_default_scenario_is_the_bench_of_the_seed():
    scenario = load_scenario("default")
    assert scenario.bench == Scenario.model_fields["bench"].default
    assert [sample.thickness_mm for sample in scenario.samples] == [0.4, 0.8]


def test_built_in_scenarios_are_listed_with_the_default_first():
    assert builtin_names()[0] == "default"
    assert {"chip", "intralipid", "polyjet-cyan", "polyjet-white", "quick"} < set(builtin_names())


def test_settled_says_everything_that_matters():
    scenario = load_scenario("default")
    quick = scenario.settled(seed=7, quick=True)
    assert quick.simulation.seed == 7
    assert quick.simulation.paths == scenario.simulation.quick_paths
    assert quick.map.paths < scenario.map.paths
    assert quick.bench == scenario.bench
    assert scenario.settled() == scenario
    assert scenario.settled(paths=100).simulation.paths == 100
    assert quick.text != scenario.text


def test_the_text_of_a_scenario_is_the_scenario():
    scenario = load_scenario("chip")
    assert Scenario.model_validate_json(scenario.text) == scenario


def test_the_grid_ends_where_it_says():
    grid = WavelengthGrid(start_nm=400, stop_nm=700, step_nm=0.2)
    wavelength = grid.wavelength_nm
    assert wavelength.size == 1501
    assert wavelength[0] == 400.0
    assert abs(wavelength[-1] - 700.0) < 1e-9
    assert np.all(np.diff(wavelength) > 0)


@pytest.mark.parametrize(
    "grid",
    [
        {"start_nm": 700.0, "stop_nm": 400.0},
        {"start_nm": 400.0, "stop_nm": 405.0, "step_nm": 2.0},
        {"start_nm": 400.0, "stop_nm": 800.0, "step_nm": 1e-3},
        {"step_nm": 0.0},
    ],
)
def test_a_grid_that_cannot_be(grid: dict[str, float], tmp_path: Path):
    with pytest.raises(InputError, match="wavelength"):
        load_scenario(write(tmp_path / "grid.toml", tiny(wavelength=grid)))


def test_the_documented_scenario_says_the_defaults(tmp_path: Path):
    text = (Path(__file__).parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
    path = tmp_path / "documented.toml"
    path.write_text(text.partition("```toml\n")[2].partition("```")[0])
    scenario = load_scenario(path)
    plain = load_scenario("intralipid")
    for name in ("bench", "wavelength", "protocol", "simulation", "map"):
        assert getattr(scenario, name) == getattr(plain, name)


def test_samples_of_two_materials_are_two_visits(tmp_path: Path):
    table = tiny()
    table["samples"][1]["material"] = "demo_ink"
    with pytest.raises(InputError) as error:
        load_scenario(write(tmp_path / "two.toml", table))
    assert "one material" in error.value.expected


@given(st.text(max_size=200))
def test_any_text_is_a_scenario_or_a_clear_error(
    tmp_path_factory: pytest.TempPathFactory, text: str
):
    path = tmp_path_factory.mktemp("any") / "any.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(InputError):  # no text this short is a whole scenario
        load_scenario(path)


@given(
    st.dictionaries(
        st.sampled_from(["title", "samples", "bench", "wavelength", "protocol", "map", "x"]),
        st.one_of(
            st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5),
            st.lists(st.integers(), max_size=3),
        ),
        min_size=1,
    )
)  # fmt: skip
def test_any_values_are_a_scenario_or_a_clear_error(
    tmp_path_factory: pytest.TempPathFactory, changes: dict[str, object]
):
    path = tmp_path_factory.mktemp("any") / "any.json"
    path.write_text(json.dumps(tiny() | changes))
    found = outcome(path)
    assert found.title if isinstance(found, Scenario) else found.found and found.expected


def outcome(path: Path) -> Scenario | InputError:
    try:
        return load_scenario(path)
    except InputError as error:
        return error
