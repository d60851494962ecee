"""A scenario small enough to run in a second or two, and ways to call the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import tomli_w
from typer.testing import CliRunner, Result

from scenarios.cli import app

MATERIAL = {"albedo": 0.8, "sigma_t_per_mm": 3.0, "g": 0.6}


def tiny(**changes: Any) -> dict[str, Any]:
    """The scenario as a table; changes replace top-level keys."""
    table: dict[str, Any] = {
        "title": "Small enough for a test",
        "samples": [
            {"name": "thin", "thickness_mm": 0.4, "n": 1.4, "material": MATERIAL},
            {"name": "thick", "thickness_mm": 0.8, "n": 1.4, "material": MATERIAL},
        ],
        "bench": {
            "instrument": {
                "kind": "spectrometer",
                "start_nm": 450.0,
                "stop_nm": 650.0,
                "step_nm": 25.0,
                "bandwidth_nm": 10.0,
            }
        },
        "wavelength": {"start_nm": 425.0, "stop_nm": 675.0, "step_nm": 50.0},
        "protocol": {"repeats": 2, "reference_repeats": 2},
        "simulation": {"paths": 1024, "quick_paths": 256, "seed": 5},
        "map": {"albedo_count": 8, "sigma_t_count": 8, "g_count": 3, "paths": 512},
        "estimator": {"name": "lut", "options": {"draws": 60}},
    }
    return table | changes


def write(path: Path, table: dict[str, Any]) -> Path:
    """Write a scenario file."""
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


def call(*arguments: object) -> Result:
    """Run the command in this process."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def answer(result: Result) -> dict[str, Any]:
    """The one JSON object on standard output."""
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)
