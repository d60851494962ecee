"""Sweeps: two workers over one, what a point costs besides its work, equal bytes, kills.

Keys:

- `scaling_2`: time of one worker over that of two, points of the Monte Carlo on one thread each,
  both pools started and warm; `seconds_1`, `seconds_2`, `points`.
- `overhead_ms`: time per point of points that do nothing, by engine; the ledger's write is in it.
- `equal_bytes`: serial, joblib and Dask, with one and with two workers, give one digest.
- `kills`: how often a sweep was killed at a random moment (of `kills_tried`) and resumed;
  `lost`: results that were recorded before a kill and not after, or missing at the end;
  `repeated`: points done again although their result was recorded; `done_again_unrecorded`: those
  under way when the kill came.
"""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from twin.spectra import FloatArray

HERE = "benchmarks.sweep"
VERSION = "1"
RECORDED = "SELECT point FROM points WHERE result IS NOT NULL"


def light(point: dict[str, Any]) -> dict[str, FloatArray]:
    """Captures of one material by the Monte Carlo, on one thread."""
    from twin.bench import Bench, Medium, Sample
    from twin.transport import captures

    medium = Medium(albedo=point["albedo"], sigma_t_per_mm=point["sigma_t"], g=point["g"])
    sample = Sample(name="medium", thickness_mm=0.8, material=medium)
    found = captures(
        Bench(), sample, np.array([550.0]), paths=point["paths"], seed=point["seed"], threads=1
    )
    return {"light": np.array([found.black[0], found.white[0], found.collimated[0]])}


def nothing(point: dict[str, Any]) -> dict[str, FloatArray]:
    """No work."""
    return {"number": np.array(float(point["number"]))}


def slow(point: dict[str, Any]) -> dict[str, FloatArray]:
    """A little work that says in a file that it began."""
    with Path(point["log"]).open("a", encoding="utf-8") as log:
        log.write(f"{point['number']}\n")
    time.sleep(0.004)
    return {"number": np.random.Generator(np.random.Philox(key=point["number"])).normal(size=64)}


def killed(folder: str, log: str, count: str) -> None:
    """The sweep that is killed: two processes."""
    from scenarios.sweep import Workers, sweep

    points = [{"number": number, "log": log} for number in range(int(count))]
    workers = Workers(engine="joblib", count=2)
    sweep(f"{HERE}:slow", points, Path(folder), version=VERSION, workers=workers)


def scaling(quick: bool) -> dict[str, Any]:
    """One worker against two, and the engines' bytes."""
    from scenarios.sweep import Workers, sweep

    count, paths = (12, 1 << 14) if quick else (48, 1 << 17)
    rng = np.random.Generator(np.random.Philox(key=20261122))

    def points(many: int, size: int) -> list[dict[str, Any]]:
        return [
            {
                "albedo": float(rng.uniform(0.6, 0.99)),
                "sigma_t": float(rng.uniform(1.0, 8.0)),
                "g": float(rng.uniform(0.0, 0.9)),
                "paths": size,
                "seed": number,
            }
            for number in range(many)
        ]

    work, warm = points(count, paths), points(8, 1 << 8)
    seconds: dict[int, float] = {}
    digests: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:

        def timed(name: str, workers: Workers, what: list[dict[str, Any]]) -> float:
            begin = time.perf_counter()
            done = sweep(
                f"{HERE}:light", what, Path(folder) / name, version=VERSION, workers=workers
            )
            digests[name] = done.digest
            return time.perf_counter() - begin

        # joblib does the points of one worker in this process: both are warm when they are timed.
        for number in (1, 2):
            workers = Workers(engine="joblib", count=number)
            timed(f"warm {number}", workers, warm)
            seconds[number] = timed(f"joblib {number}", workers, work)
        few = work[: max(4, count // 6)]
        small = {
            name: Workers(engine=engine, count=number)  # type: ignore[arg-type]
            for name, engine, number in (
                ("serial", "serial", 1),
                ("joblib", "joblib", 2),
                ("dask 1", "dask", 1),
                ("dask 2", "dask", 2),
            )
        }
        for name, workers in small.items():
            timed(f"few {name}", workers, few)
    equal = len({digests[f"few {name}"] for name in small}) == 1
    return {
        "points": count,
        "seconds_1": seconds[1],
        "seconds_2": seconds[2],
        "scaling_2": seconds[1] / seconds[2],
        "equal_bytes": equal and digests["joblib 1"] == digests["joblib 2"],
    }


def overhead(quick: bool) -> dict[str, Any]:
    """Time per point that does nothing, pools started."""
    from scenarios.sweep import Workers, sweep

    count = 200 if quick else 2000
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for engine in ("serial", "joblib", "dask"):
            workers = Workers(engine=engine, count=2)
            spent = []
            for size in (20, 20 + count):
                where = Path(folder) / f"{engine} {size}"
                points = [{"number": number} for number in range(size)]
                begin = time.perf_counter()
                sweep(f"{HERE}:nothing", points, where, version=VERSION, workers=workers)
                spent.append(time.perf_counter() - begin)
            found[engine] = 1e3 * (spent[1] - spent[0]) / count
    return {"overhead_ms": found}


def kills(quick: bool) -> dict[str, Any]:
    """Kill a sweep at random moments and resume it."""
    tried, count = (4, 400) if quick else (20, 3000)
    rng = random.Random(20261122)
    landed = lost = repeated = 0
    with tempfile.TemporaryDirectory() as place:
        folder, log = Path(place) / "sweep", Path(place) / "log"
        log.touch()
        call = f"from {HERE} import killed; killed({str(folder)!r}, {str(log)!r}, '{count}')"
        ledger = folder / "ledger.sqlite"
        recorded: set[str] = set()
        for _ in range(tried):
            before = log.stat().st_size
            process = subprocess.Popen([sys.executable, "-c", call], start_new_session=True)
            # Past its start-up, then at any moment.
            while process.poll() is None and log.stat().st_size == before:
                time.sleep(0.001)
            time.sleep(rng.uniform(0.0, 0.3))
            os.killpg(process.pid, signal.SIGKILL)
            landed += process.wait() == -signal.SIGKILL
            begun = log.read_bytes()[before:].decode().split()
            repeated += len({f'"number":{number}}}' for number in begun} & _tails(recorded))
            now = _recorded(ledger)
            lost += len(recorded - now)
            recorded = now
        subprocess.run([sys.executable, "-c", call], check=True)
        lost += count - len(_recorded(ledger))
        times = Counter(log.read_text(encoding="utf-8").split())
    return {
        "kills_tried": tried,
        "kills": landed,
        "lost": lost,
        "repeated": repeated,
        "done_again_unrecorded": sum(times.values()) - len(times),
    }


def _recorded(ledger: Path) -> set[str]:
    with closing(sqlite3.connect(ledger)) as base:
        return {row[0] for row in base.execute(RECORDED)}


def _tails(points: set[str]) -> set[str]:
    """The end of each point's text, which holds its number."""
    return {text[text.rindex('"number"') :].replace(" ", "") for text in points}


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the module's docstring for the keys."""
    return {**scaling(quick), **overhead(quick), **kills(quick)}
