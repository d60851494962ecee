"""The pages that tell how to build a bench: their commands run in their order, on stand-ins."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from pydantic import BaseModel
from typer.testing import CliRunner

from hw_adapters import PlanSettings
from scenarios.cli import app
from scenarios.instruments.bench_file import BenchFile, LightsEntry, SensorEntry, StageEntry
from twin.errors import InputError
from twin.measurement import read_measurement, relative_intensities
from twin.toml import parse_toml

pytest.importorskip("seabreeze", reason="python-seabreeze is not installed (extra instruments)")
pytest.importorskip("adafruit_as7341", reason="its driver is not installed (extra instruments)")
pytest.importorskip("serial", reason="pyserial is not installed (extra instruments)")
pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed (extra instruments)")

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)


def follow(page: Path, folder: Path) -> int:
    """Write the page's files and run its commands; what it shows must be in what they say.

    Returns:
        Number of commands.
    """
    commands = 0
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language == "toml":
            first, body = text.split("\n", 1)
            name = first.removeprefix("# ")
            if name.startswith("add to "):
                path = folder / name.removeprefix("add to ")
                path.write_text(body + path.read_text(encoding="utf-8"), encoding="utf-8")
            else:
                (folder / name).write_text(body, encoding="utf-8")
        if language == "console":
            commands += 1
            command, *shown = text.splitlines()
            assert command.startswith("$ benchtwin ")
            check(command, shown)
    return commands


def check(command: str, shown: list[str]) -> None:
    """Run one command. It fails where the page shows its message, and only there."""
    result = CliRunner().invoke(app, shlex.split(command)[2:])
    fails = any(line.startswith("benchtwin: ") for line in shown)
    assert result.exit_code == (2 if fails else 0), result.output
    said = re.sub(r"\s+", " ", result.stdout + result.stderr)
    for line in shown:
        parts = (re.escape(part.strip()) for part in re.sub(r"\s+", " ", line).split("..."))
        assert re.search(".*".join(parts), said), f"{command}: not said: {line}\n{said}"


@pytest.mark.parametrize(
    ("page", "expected"), [("build_29_dollars.md", 7), ("build_2000_dollars.md", 6)]
)
def test_the_page_can_be_followed(
    page: str, expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BENCHTWIN_CACHE", str(tmp_path / "cache"))
    assert follow(DOCS / page, tmp_path) == expected
    measurement = read_measurement(tmp_path / "visit" / "measurement.nc")
    assert measurement.provenance.origin == "simulated"
    assert any(note.endswith("(wire)") for note in measurement.provenance.notes)
    assert relative_intensities(measurement).value.shape[:2] == (2, 3)
    for name in ("report.html", "result.csv", "result.nc"):
        assert (tmp_path / "result" / name).stat().st_size > 0
    if page == "build_29_dollars.md":
        assert read_measurement(tmp_path / "tables") == measurement


def test_a_page_that_promises_too_much_is_caught() -> None:
    check("$ benchtwin list estimators", ["lut"])
    with pytest.raises(AssertionError, match="not said: crystal-ball"):
        check("$ benchtwin list estimators", ["crystal-ball"])
    with pytest.raises(AssertionError):
        check("$ benchtwin list nothing", ["lut"])


def test_only_one_line_turns_the_bench_files_real() -> None:
    for page in ("build_29_dollars.md", "build_2000_dollars.md"):
        blocks = dict(
            text.split("\n", 1) for language, text in BLOCK.findall((DOCS / page).read_text())
            if language == "toml"
        )  # fmt: skip
        text = blocks["# bench.toml"]
        wire = parse_toml(text, BenchFile)
        real = parse_toml(text.replace('kind = "wire"', 'kind = "real"'), BenchFile)
        for kind, file in (("wire", wire), ("real", real)):
            assert {file.sensor.kind, file.lights.kind, file.stage.kind} == {kind}
        assert real.is_real
        with pytest.raises(InputError, match="'reel'"):
            parse_toml(text.replace('kind = "wire"', 'kind = "reel"'), BenchFile)


@pytest.mark.parametrize(
    ("title", "model"),
    [
        ("At the top", BenchFile), ("`[sensor]`", SensorEntry), ("`[lights]`", LightsEntry),
        ("`[stage]`", StageEntry), ("`[plan]`", PlanSettings),
    ],
)  # fmt: skip
def test_every_key_of_a_bench_file_is_documented(title: str, model: type[BaseModel]) -> None:
    text = (DOCS / "bench_file.md").read_text(encoding="utf-8")
    part = text.split(f"## {title}\n")[1].split("\n## ")[0]
    cells = re.findall(r"^\| (`[^|]*`) \| ([^|]*) \|", part, re.MULTILINE)
    named = {name for cell, _ in cells for name in re.findall(r"`(\w+)`", cell)}
    tables = {"sensor", "lights", "stage", "plan"} if model is BenchFile else set()
    assert named | tables == set(model.model_fields)
    for cell, default in cells:
        key, stated = cell.strip("`"), default.strip().strip("`").strip('"')
        if key in model.model_fields and re.fullmatch(r"[\d.]+", stated) and key != "gain":
            assert float(stated) == float(str(model.model_fields[key].default))
