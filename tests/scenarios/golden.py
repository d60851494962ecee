"""The key numbers of the default scenario, quick. To store them again, from the repository:

    python -m tests.scenarios.golden

Numbers are averages, so that other random numbers change them by less than the tolerances; what
moves them further is another physics.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.commands import run_scenario
from scenarios.console import Console

FILE = Path(__file__).with_name("golden.json")
SEED = 1
INTENSITY_TOLERANCE = 0.02
"""Relative: seeds 1 to 4 differ by at most 0.8 %."""
PARAMETER_TOLERANCE = {"albedo": 0.01, "sigma_t_per_mm": 0.02, "g": 0.02}
"""Absolute: seeds 1 to 4 differ by at most 0.002, 0.0021 and 0.0023."""


def key_numbers(cache: Path, out: Path) -> dict[str, Any]:
    """Run the default scenario quickly and take its key numbers."""
    from twin.measurement import read_measurement, relative_intensities

    summary = run_scenario(
        "default", out=out, seed=SEED, quick=True, cache=cache, console=Console(quiet=True)
    )
    found = relative_intensities(read_measurement(out / "measurement.nc"))
    return {
        "mean_intensity": np.nanmean(found.value, axis=2).round(5).tolist(),
        "wavelengths": summary["wavelengths"],
        "determined": {k: v["determined"] for k, v in summary["estimate"].items()},
        "median": {k: round(v["median"], 5) for k, v in summary["estimate"].items()},
        "usable": sum(n for status, n in summary["status"].items() if status in USABLE),
    }


USABLE = ("ok", "inconsistent")


def deviations(found: dict[str, Any], stored: dict[str, Any]) -> list[str]:
    """What differs by more than its tolerance."""
    ratio = np.array(found["mean_intensity"]) / np.array(stored["mean_intensity"]) - 1
    wrong = [
        f"mean intensity of sample {s}, capture {c}: {ratio[s, c]:+.3f}"
        for s, c in np.argwhere(np.abs(ratio) > INTENSITY_TOLERANCE)
    ]
    wrong += [
        f"median {name}: {found['median'][name]} instead of {stored['median'][name]}"
        for name, tolerance in PARAMETER_TOLERANCE.items()
        if abs(found["median"][name] - stored["median"][name]) > tolerance
    ]
    if found["wavelengths"] != stored["wavelengths"]:
        wrong.append(f"{found['wavelengths']} wavelengths")
    if found["usable"] < 0.9 * stored["usable"]:
        wrong.append(f"only {found['usable']} usable wavelengths")
    return wrong


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        numbers = key_numbers(Path(folder) / "cache", Path(folder) / "out")
    FILE.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(numbers, indent=1))
