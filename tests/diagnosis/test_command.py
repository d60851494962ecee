"""`benchtwin diagnose` from a file to a verdict, a report and a bench that has what was found."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any, NamedTuple, get_args

import pytest

from diagnosis import Verdict
from tests.diagnosis.visits import equally_thick, visit, without_the_rest, written
from tests.scenarios.tiny import answer, call
from twin.bench import Bench
from twin.toml import load_toml

TRUE = 0.05
"""Relative error of the middle sample's thickness."""
FILES = {"diagnosis.html", "diagnosis.json", "bench.toml"}
PAGE = (Path(__file__).parents[2] / "docs" / "diagnosis.md").read_text("utf-8")
KEYS = {
    "verdict", "effects", "groups", "where", "closure", "parameter_shift", "next_measurement",
    "not_identifiable",
}  # fmt: skip


class Finished(NamedTuple):
    file: Path
    folder: Path
    cache: Path
    answer: dict[str, Any]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    base = tmp_path_factory.mktemp("diagnosis")
    (base / "visit").mkdir()
    file = written(visit("thickness[0.8 mm]", TRUE), base / "visit" / "measurement.nc")
    folder, cache = base / "out", base / "maps"
    result = call(
        "diagnose", file, "--quick", "--rounds", 3, "--out", folder, "--cache", cache, "--json",
        *without_the_rest(),
    )  # fmt: skip
    assert "signatures of the effects: done" in result.stderr
    return Finished(file, folder, cache, answer(result))


def test_the_withheld_effect_is_named_with_its_value(finished: Finished) -> None:
    found = finished.answer
    assert found.keys() >= KEYS
    assert found["verdict"] == "effect"
    first = found["effects"][0]
    assert first["name"] == "thickness[0.8 mm]"
    assert first["probability"] > 0.9
    assert first["place"] == "sample"
    value = first["parameters"][0]
    assert value["unit"] == "1"
    assert value["nominal"] == 0.0
    assert abs(value["value"] - TRUE) < 4 * value["sd"]
    assert value["sd"] < 0.2 * TRUE


def test_how_far_the_gap_shrinks_is_said_with_an_interval(finished: Finished) -> None:
    closure = finished.answer["closure"]
    low, high = closure["interval"]
    assert low < closure["value"] < high
    assert low > 0.8
    assert closure["before"] > 10 * abs(closure["after"])
    assert {"noise_floor", "oracle_floor"} <= closure.keys()
    moved = finished.answer["parameter_shift"]["ln sigma_t"]["rms_sd"]
    assert moved > 1


def test_rounds_go_on_until_nothing_is_left(finished: Finished) -> None:
    verdicts = [one["verdict"] for one in finished.answer["rounds"]]
    assert verdicts == ["effect", "no_gap"]
    assert finished.answer["rounds"][1]["accepted"] == []
    assert finished.answer["stopped"] == "the verdict no gap"


def test_the_bench_that_is_written_holds_value_and_uncertainty(finished: Finished) -> None:
    bench = load_toml(finished.folder / "bench.toml", Bench)
    assert [each.name for each in bench.effects] == ["thickness[0.8 mm]"]
    assert len(bench.effects[0].uncertainty) == 1
    assert bench.effects[0].uncertainty[0] > 0


def test_the_commands_of_the_page_run(finished: Finished, monkeypatch: pytest.MonkeyPatch) -> None:
    """One diagnosis, rounds, and the bench they wrote: the last finds no gap."""
    monkeypatch.chdir(finished.file.parent.parent)
    block = re.search(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    assert block is not None
    lines = [shlex.split(line, comments=True) for line in block.group(1).splitlines()]
    assert len(lines) == 3
    lines[2] += ["--report", "elsewhere.html"]
    said = []
    for command, *arguments in lines:
        assert command == "benchtwin"
        more = ("--quick", "--quiet", "--cache", finished.cache, *without_the_rest())
        result = call(*arguments, *more)
        assert result.exit_code == 0, result.stderr
        said.append(result.stdout)
    assert "One effect makes the gap" in said[0]
    assert "of the gap closes" in said[0]
    assert "enters in" in said[0]
    assert "2: no gap" in said[1]
    assert "No gap" in said[2].splitlines()[0]
    assert Path("elsewhere.html").exists()
    assert {path.name for path in Path("gap").iterdir()} == FILES
    assert all(f"`{name}`" in PAGE for name in FILES)


def test_the_python_of_the_page_runs(finished: Finished, monkeypatch: pytest.MonkeyPatch) -> None:
    from scenarios.commands import diagnosis as command
    from tests.diagnosis.visits import small_catalogue

    monkeypatch.chdir(finished.file.parent.parent)
    monkeypatch.setenv("BENCHTWIN_CACHE", str(finished.cache.parent))
    monkeypatch.setattr("twin.effects.catalogue", small_catalogue)
    monkeypatch.setattr(command, "MAPS", command.QUICK_MAPS)
    block = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert block is not None
    known: dict[str, Any] = {}
    exec(compile(block.group(1), "docs/diagnosis.md", "exec"), known)  # noqa: S102 - our own page
    assert known["found"]["verdict"] == "effect"


def test_every_option_and_verdict_is_on_the_page() -> None:
    for verdict in get_args(Verdict):
        assert f"`{verdict}`" in PAGE
    text = call("diagnose", "--help").stdout
    for option in ("--bench", "--rounds", "--without", "--quick", "--cache"):
        assert option in text
        assert f"`{option}" in PAGE


def test_the_report_is_one_file_with_every_picture(finished: Finished) -> None:
    page = (finished.folder / "diagnosis.html").read_text("utf-8")
    for name in ("residual-maps", "signatures", "evidence", "separations", "closure", "material",
                 "rest", "covariance"):  # fmt: skip
        assert f'id="{name}-' in page, name
    assert "a sample is thicker or thinner than stated (0.8 mm)" in page
    assert "<script" not in page
    assert "<image" not in page, "the page's policy shows no embedded image"
    assert not re.search(r'(?:src|href)="(?!#)', page)


def test_the_json_file_is_what_was_printed(finished: Finished) -> None:
    kept = json.loads((finished.folder / "diagnosis.json").read_text("utf-8"))
    printed = {k: v for k, v in finished.answer.items() if k not in ("folder", "report")}
    assert kept == printed


def test_one_thickness_says_what_to_measure(tmp_path: Path) -> None:
    file = written(visit(thickness=(0.8,)), tmp_path / "one.nc")
    found = answer(call("diagnose", file, "--out", tmp_path, "--json", "--quiet"))
    assert found["verdict"] == "cannot_tell"
    assert "Measure at least two more thicknesses" in found["reason"]
    assert "black_level" in [each["name"] for each in found["not_identifiable"]]
    assert found["closure"] is None


def test_equal_thicknesses_cannot_tell_either(finished: Finished, tmp_path: Path) -> None:
    file = written(equally_thick(visit(), 0.8), tmp_path / "equal.nc")
    result = call("diagnose", file, "--out", tmp_path, "--quiet")
    assert result.exit_code == 0
    assert "equally thick" in result.stdout


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[detector]\nacceptance_deg = -1.0\n", "acceptance_deg"),
        ("detector = [\n", "TOML"),
        ('effects = [{ name = "gremlins", values = [1.0] }]\n', "gremlins"),
        ('effects = [{ name = "thickness[7 mm]", values = [0.1] }]\n', "thickness[7 mm]"),
    ],
)
def test_an_impossible_bench_is_one_message(
    finished: Finished, tmp_path: Path, text: str, said: str
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(text, encoding="utf-8")
    result = call("diagnose", finished.file, "--bench", bench, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "bench.toml" in result.stderr
    assert said in result.stderr
    assert not (tmp_path / "out").exists()


def test_what_serves_the_translucent_bench_alone_is_refused_by_name(tmp_path: Path) -> None:
    spheres = tmp_path / "phantom.rxt"
    spheres.write_text("IAD1\n", encoding="utf-8")
    result = call("diagnose", spheres, "--rounds", 2, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "found --rounds for spheres" in result.stderr
    assert not (tmp_path / "out").exists()
    assert call("diagnose", spheres, "--out", tmp_path / "out").exit_code == 2
    fluorescence = tmp_path / "marker"
    fluorescence.mkdir()
    (fluorescence / "visit.toml").write_text('sample = "marker"\n', encoding="utf-8")
    result = call("diagnose", fluorescence)
    assert result.exit_code == 2
    assert "marker" in result.stderr


def test_a_fluorescence_visit_gets_its_verdict(tmp_path: Path) -> None:
    from twin.fluorescence import example, named_setup, simulate_fluorescence, write_visit

    visit = simulate_fluorescence(named_setup("l1-s2"), example("pink_paper"), seed=3)
    write_visit(visit, tmp_path / "visit.nc")
    result = call("diagnose", tmp_path / "visit.nc", "--out", tmp_path / "out", "--json", "-q")
    found = answer(result)
    assert found["kind"] == "fluorescence"
    assert found["verdict"] == "no_gap"
    stored = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert stored["p"] == found["p"]


def test_wrong_options_are_one_message(finished: Finished, tmp_path: Path) -> None:
    result = call("diagnose", finished.file, "--without", "thicknes", "--out", tmp_path)
    assert result.exit_code == 2
    assert 'Did you mean "thickness"' in result.stderr
    result = call("diagnose", finished.file, "--rounds", 0, "--out", tmp_path)
    assert result.exit_code == 2
    assert "1 or more" in result.stderr
