"""The built-in fluorescence scenarios, and scenarios of one's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenarios.fluorescence import (
    builtin_names,
    is_fluorescence_scenario,
    load_scenario,
    material_of,
    simulate_visit,
    simulated_data,
)
from twin.errors import InputError
from twin.fluorescence import example, write_matrix_csv

OWN = """title = "Own dye"
add = ["pink_paper"]
[setup]
lights = "L1"
detector = "S2"
[material]
base = 0.8
fluorophores = {fluorescein = 0.3}
"""


def test_the_seed_s_setups_are_built_in_and_give_data():
    assert builtin_names() == ("l1-s1", "l1-s2", "l2-s1", "l2-s2", "reference")
    for name in builtin_names():
        scenario = load_scenario(name)
        assert is_fluorescence_scenario(name)
        data = simulated_data(scenario)
        assert data.valid.all()
        gap = data.value - data.system.captures(data.truth)
        assert np.abs(gap).max() < 0.01 * data.value.max()


def test_a_scenario_keeps_its_text_and_can_be_repeated_from_it(tmp_path: Path):
    visit = simulate_visit(load_scenario("l1-s2"), seed=7)
    path = tmp_path / "scenario.json"
    path.write_text(visit.provenance.scenario)
    assert is_fluorescence_scenario(path)
    again = simulate_visit(load_scenario(path))
    np.testing.assert_array_equal(again.counts, visit.counts)


def test_own_materials_and_files(tmp_path: Path):
    path = tmp_path / "own.toml"
    path.write_text(OWN)
    scenario = load_scenario(path)
    assert scenario.setup.price_usd == 29
    matrix = material_of(scenario)
    extra = example("pink_paper").fluorescence
    assert np.all(matrix.fluorescence >= extra)
    write_matrix_csv(matrix, tmp_path / "m.csv")
    path.write_text('title = "file"\nmaterial = "m.csv"\n[setup]\nlights = "L1"\ndetector = "S2"\n')
    np.testing.assert_array_equal(material_of(load_scenario(path)).matrix, matrix.matrix)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pink_paper", "pink", "material 'pink'"),
        ('"L1"', '"L7"', "L1, L2 or monochromator"),
        ('"S2"', '"S7"', "detector 'S7'"),
        ("fluorescein =", "fluorescin =", "fluorescein"),
        ("base = 0.8", "base = 1.8", "base"),
        ("[material]", "[materials]", "materials"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old, new, message):
    path = tmp_path / "own.toml"
    path.write_text(OWN.replace(old, new))
    with pytest.raises(InputError, match=message):
        material_of(load_scenario(path))


def test_names_that_are_none_and_other_scenarios_are_told_apart(tmp_path: Path):
    with pytest.raises(InputError, match="l1-s1"):
        load_scenario("l1-s3")
    other = tmp_path / "translucent.toml"
    other.write_text('title = "x"\n[bench]\n')
    assert not is_fluorescence_scenario(other)
    assert not is_fluorescence_scenario("default")
