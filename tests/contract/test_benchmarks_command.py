"""`python -m benchmarks`: names, one JSON object, progress beside it, exit codes."""

from __future__ import annotations

import json
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import benchmarks.__main__ as command
from tests.contract.repository import run_python
from twin.errors import InputError


@pytest.fixture
def planted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Put a benchmark in place of the real ones: its source is the argument."""

    def plant(body: str) -> None:
        source = '"""Measures nothing.\n\nMore."""\n' + textwrap.dedent(body)
        (tmp_path / "sample.py").write_text(source, encoding="utf-8")
        (tmp_path / "_helper.py").write_text("def run(quick): ...", encoding="utf-8")
        (tmp_path / "other.py").write_text("'''No benchmark.'''", encoding="utf-8")
        monkeypatch.setattr(command, "discover", lambda: DISCOVER(tmp_path))
        monkeypatch.setattr("benchmarks.__path__", [str(tmp_path)])
        sys.modules.pop("benchmarks.sample", None)

    yield plant
    sys.modules.pop("benchmarks.sample", None)


DISCOVER = command.discover


def test_a_benchmark_is_a_module_with_run(planted, capfd: pytest.CaptureFixture[str]):
    planted("def run(quick): return {}")
    assert command.main(["--list"]) == 0
    assert capfd.readouterr().out.split() == ["sample", "Measures", "nothing."]


def test_json_is_one_object_and_progress_goes_to_standard_error(
    planted, capfd: pytest.CaptureFixture[str]
):
    planted("""
        import os

        def run(quick):
            print("progress")
            os.write(1, b"from compiled code\\n")
            return {"seconds": 2.5, "quick_run": quick}
        """)
    assert command.main(["sample", "--json", "--quick"]) == 0
    shown = capfd.readouterr()
    report = json.loads(shown.out)
    assert shown.out.count("\n") == 1
    assert report["benchmark"] == "sample"
    assert report["quick"] is report["quick_run"] is True
    assert report["seconds"] == 2.5
    assert report["machine"]["cores"] >= 1
    assert report["machine"]["versions"]["numpy"] == np.__version__
    assert "progress" in shown.err
    assert "from compiled code" in shown.err


def test_the_table_shows_every_figure(planted, capfd: pytest.CaptureFixture[str]):
    planted("""
        def run(quick):
            return {"seconds": 2.5, "cases": [{"n": 1.5, "z": 0.25}], "nested": {"rows": 7}}
        """)
    assert command.main(["sample"]) == 0
    lines = [line.split() for line in capfd.readouterr().out.splitlines()]
    assert ["seconds", "2.5"] in lines
    assert ["n", "1.5", "z", "0.25"] in lines
    assert ["rows", "7"] in lines


@pytest.mark.parametrize("arguments", [[], ["smaple"]])
def test_an_unknown_name_is_answered_with_the_known_ones(
    planted, arguments: list[str], capfd: pytest.CaptureFixture[str]
):
    planted("def run(quick): return {}")
    assert command.main(arguments) == command.EXIT_INPUT == 2
    shown = capfd.readouterr()
    assert shown.out == ""
    assert "expected one of: sample" in shown.err


def test_a_missing_library_is_named(planted, capfd: pytest.CaptureFixture[str]):
    planted("def run(quick): import no_such_peer")
    assert command.main(["sample", "--json"]) == command.EXIT_UNAVAILABLE
    shown = capfd.readouterr()
    assert shown.out == ""
    assert "no_such_peer" in shown.err


def test_a_missing_module_of_ours_is_not_called_a_missing_library(planted):
    planted("def run(quick): import twin.no_such_module")
    with pytest.raises(ModuleNotFoundError):
        command.main(["sample"])


def test_an_input_that_cannot_be_used_is_said_without_traceback(
    planted, capfd: pytest.CaptureFixture[str]
):
    planted("""
        from twin.errors import InputError

        def run(quick):
            raise InputError("no file", "the reference values", file="reference_values.csv")
        """)
    assert command.main(["sample"]) == command.EXIT_INPUT
    expected = InputError("no file", "the reference values", file="reference_values.csv")
    assert capfd.readouterr().err.strip() == str(expected)


def test_what_json_cannot_hold_becomes_null_or_an_error():
    assert command.plain({"a": np.array([1.0, np.nan]), "b": np.int64(3)}) == {
        "a": [1.0, None],
        "b": 3,
    }
    with pytest.raises(TypeError, match="object"):
        command.plain({"a": object()})


def test_the_module_runs_as_a_command():
    done = run_python("-m", "benchmarks", "no-such-benchmark")
    assert done.returncode == 2
    assert done.stdout == ""
    assert "no-such-benchmark" in done.stderr
    assert "Traceback" not in done.stderr
