"""The first minute of a new user: help, and the default scenario with nothing cached.

Every run is a fresh process with empty caches for compiled kernels and appearance maps.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

COMMAND = [sys.executable, "-c", "from scenarios.cli import main; main()"]


def run(quick: bool) -> dict[str, Any]:
    """Time `benchtwin --help` (median of five) and `benchtwin run` (cold).

    Args:
        quick: run the default scenario with --quick.
    """
    help_seconds = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run([*COMMAND, "--help"], check=True, capture_output=True)
        help_seconds.append(time.perf_counter() - start)
    with tempfile.TemporaryDirectory() as folder:
        environment = dict(
            os.environ,
            BENCHTWIN_CACHE=str(Path(folder) / "cache"),
            WARP_CACHE_PATH=str(Path(folder) / "warp"),
        )
        arguments = ["run", "--out", str(Path(folder) / "out")] + (["--quick"] if quick else [])
        start = time.perf_counter()
        subprocess.run([*COMMAND, *arguments], check=True, capture_output=True, env=environment)
        seconds = time.perf_counter() - start
    kilobytes = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return {
        "help_s": median(help_seconds),
        "run_s": seconds,
        "peak_memory_gb": kilobytes / 1e6,
    }
