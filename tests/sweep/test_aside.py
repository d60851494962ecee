"""What stands beside a point: no part of its key; a task that says its own time; what is left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scenarios.sweep import Timed, finished, sweep
from tests.sweep.tasks import SQUARE

POINTS = [{"x": x} for x in range(3)]


def timed(point: dict[str, Any]) -> Timed:
    """A task that says that it took so many seconds."""
    return Timed({"x": np.array(float(point["x"]))}, 10.0 * point["x"])


def test_what_stands_aside_reaches_the_task_and_not_the_key(tmp_path: Path) -> None:
    logs = [str(tmp_path / name) for name in ("one", "two")]
    first = sweep(SQUARE, POINTS, tmp_path, version="1", aside={"log": logs[0]})
    assert Path(logs[0]).read_text().split() == ["0", "1", "2"]
    again = sweep(SQUARE, POINTS, tmp_path, version="1", aside={"log": logs[1]})
    assert not Path(logs[1]).exists()
    assert again.digest == first.digest
    assert again.keys == sweep(SQUARE, POINTS, tmp_path, version="1").keys


def test_a_task_may_say_its_own_time(tmp_path: Path) -> None:
    done = sweep("tests.sweep.test_aside:timed", POINTS, tmp_path, version="1")
    assert done.seconds() == [0.0, 10.0, 20.0]
    assert [float(found["x"]) for found in done.results() if found] == [0.0, 1.0, 2.0]


def test_what_is_left_is_known_before_the_work(tmp_path: Path) -> None:
    assert not finished(SQUARE, POINTS, tmp_path, version="1")
    sweep(SQUARE, POINTS, tmp_path, version="1")
    assert finished(SQUARE, [*POINTS, POINTS[0]], tmp_path, version="1")
    assert not finished(SQUARE, [*POINTS, {"x": 9}], tmp_path, version="1")
    assert not finished(SQUARE, POINTS, tmp_path, version="2")
