"""The pages that tell how to build a bench: keys and files. tests/docs runs their commands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from hw_adapters import PlanSettings
from scenarios.instruments.bench_file import BenchFile, LightsEntry, SensorEntry, StageEntry
from twin.errors import InputError
from twin.toml import parse_toml

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)


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
