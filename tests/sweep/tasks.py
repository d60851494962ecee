"""Tasks of the sweep tests: worker processes import them by name."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np

from twin.spectra import FloatArray

SQUARE = "tests.sweep.tasks:square"
MOODY = "tests.sweep.tasks:moody"


def square(point: dict[str, Any]) -> dict[str, FloatArray]:
    """Depends on the point alone; says in a file that it was called."""
    if "log" in point:
        with Path(point["log"]).open("a") as log:
            log.write(f"{point['x']}\n")
    rng = np.random.Generator(np.random.Philox(key=point["x"]))
    return {"square": np.array(float(point["x"]) ** 2), "noise": rng.normal(size=(2, 3))}


def moody(point: dict[str, Any]) -> dict[str, FloatArray]:
    """Raises, or kills its process, as the point says."""
    if point["mood"] == "raise":
        raise ValueError(f"no square of {point['x']}")
    if point["mood"] == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if point["mood"] == "die once" and not Path(point["mark"]).exists():
        Path(point["mark"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"x": np.array(float(point["x"]))}
