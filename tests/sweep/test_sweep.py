"""Sweeps: the same bytes whoever works, nothing lost or repeated, failures named."""

from __future__ import annotations

import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from scenarios.sweep import Ledger, Workers, sweep
from scenarios.sweep.run import LEDGER
from tests.sweep.tasks import MOODY, SQUARE
from twin.errors import InputError

POINTS = [{"x": x} for x in range(12)]

RECORDED = "SELECT key FROM points WHERE result IS NOT NULL"
KILLED = """
import sys
from pathlib import Path
from scenarios.sweep import sweep
points = [{"x": x, "log": sys.argv[2]} for x in range(400)]
sweep("tests.sweep.tasks:square", points, Path(sys.argv[1]), version="1")
"""


def run(folder: Path, points: list[dict[str, Any]] = POINTS, **options: Any) -> Any:
    """A sweep of squares."""
    return sweep(SQUARE, points, folder, version="1", **options)


@pytest.mark.parametrize("engine", ["joblib", "dask"])
def test_every_engine_gives_the_same_bytes(tmp_path: Path, engine: Any) -> None:
    alone = run(tmp_path / "serial")
    others = run(tmp_path / engine, workers=Workers(engine=engine, count=2))
    assert others.digest == alone.digest
    assert [float(r["square"]) for r in others.results()] == [float(x**2) for x in range(12)]
    assert not others.failures


def test_another_result_gives_another_digest(tmp_path: Path) -> None:
    assert run(tmp_path / "a").digest != run(tmp_path / "b", [*POINTS[:-1], {"x": 99}]).digest


def test_what_is_there_is_not_done_again(tmp_path: Path) -> None:
    log = tmp_path / "log"
    points = [{"x": x, "log": str(log)} for x in range(4)]
    run(tmp_path, points[:2])
    first = run(tmp_path, points)
    assert sorted(log.read_text().split()) == ["0", "1", "2", "3"]
    assert run(tmp_path, points).digest == first.digest
    sweep(SQUARE, points[:1], tmp_path, version="2")
    assert log.read_text().split().count("0") == 2  # another version's results are not used


def test_a_point_that_stands_twice_is_done_once(tmp_path: Path) -> None:
    log = tmp_path / "log"
    found = run(tmp_path, [{"x": 3, "log": str(log)}] * 3)
    assert log.read_text().split() == ["3"]
    assert [float(r["square"]) for r in found.results()] == [9.0, 9.0, 9.0]


def test_killed_sweeps_go_on_and_repeat_nothing(tmp_path: Path) -> None:
    log = tmp_path / "log"
    command = [sys.executable, "-c", KILLED, str(tmp_path), str(log)]
    recorded: set[str] = set()
    kills = 0
    for lines in (1, 60, 150):
        process = subprocess.Popen(command, cwd=Path(__file__).parents[2])
        while process.poll() is None and _lines(log) < lines:
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        kills += process.wait() == -signal.SIGKILL
        with closing(sqlite3.connect(tmp_path / LEDGER)) as base:
            now = {row[0] for row in base.execute(RECORDED)}
        assert recorded <= now
        recorded = now
    assert kills == 3
    final = subprocess.run(command, cwd=Path(__file__).parents[2], check=False)
    assert final.returncode == 0
    times = Counter(log.read_text().split())
    assert len(times) == 400
    # At each kill at most the one point that was under way is done again.
    assert sum(times.values()) - 400 <= kills


def _lines(path: Path) -> int:
    return path.read_text().count("\n") if path.exists() else 0


@pytest.mark.parametrize("engine", ["serial", "joblib"])
def test_a_point_that_raises_is_named_and_the_rest_goes_on(tmp_path: Path, engine: Any) -> None:
    points = [{"x": 1, "mood": "good"}, {"x": 2, "mood": "raise"}, {"x": 3, "mood": "good"}]
    found = sweep(MOODY, points, tmp_path, version="1", workers=Workers(engine=engine, count=2))
    assert [f.number for f in found.failures] == [1]
    assert found.failures[0].message == "ValueError: no square of 2"
    results = list(found.results())
    assert results[1] is None
    assert float(results[2]["x"]) == 3.0


def test_the_death_of_a_worker_is_survived(tmp_path: Path) -> None:
    mark = str(tmp_path / "mark")
    points = [{"x": x, "mood": "good", "mark": mark} for x in range(6)]
    points[2]["mood"] = "die once"
    points[4]["mood"] = "die"
    found = sweep(MOODY, points, tmp_path, version="1", workers=Workers(engine="joblib", count=2))
    assert [f.number for f in found.failures] == [4]
    assert "died 3 times" in found.failures[0].message
    assert [r is not None for r in found.results()] == [True, True, True, True, False, True]


def test_bad_input_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="module:function"):
        sweep("tests.sweep.tasks:nothing", POINTS, tmp_path, version="1")
    with pytest.raises(InputError, match="one point or more"):
        run(tmp_path, [])
    with pytest.raises(InputError, match='"serial" or "joblib" or "dask"'):
        Workers(engine="threads")  # type: ignore[arg-type]
    with pytest.raises(InputError, match='the engine "dask"'):
        Workers(engine="joblib", scheduler="tcp://127.0.0.1:1")
    quiet = Workers(engine="dask", scheduler="tcp://127.0.0.1:9", patience_s=0.5)
    with pytest.raises(InputError, match=r"no answer from tcp://127\.0\.0\.1:9 within 0\.5 s"):
        run(tmp_path, workers=quiet)
    with pytest.raises(InputError, match="no answer from"):
        quiet.check()
    foreign = tmp_path / "foreign" / LEDGER
    foreign.parent.mkdir()
    foreign.write_bytes(b"no ledger at all" * 100)
    with pytest.raises(InputError, match="no ledger"):
        run(foreign.parent)
    assert foreign.read_bytes() == b"no ledger at all" * 100


def test_a_full_disk_keeps_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SQLite is told that the disk ends a few pages on; there is room again afterwards."""
    begun = Ledger.__init__

    def small(self: Ledger, path: Path) -> None:
        begun(self, path)
        self._base.execute("PRAGMA wal_autocheckpoint=1")
        pages = self._base.execute("PRAGMA page_count").fetchone()[0]
        self._base.execute(f"PRAGMA max_page_count={pages + 2}")

    points = [{"x": x} for x in range(60)]
    with monkeypatch.context() as patch:
        patch.setattr(Ledger, "__init__", small)
        with pytest.raises(InputError, match=r"no space for another result.*what is there is kept"):
            run(tmp_path, points)
    with closing(sqlite3.connect(tmp_path / LEDGER)) as base:
        kept = len(base.execute(RECORDED).fetchall())
    assert 0 < kept < len(points)
    whole = run(tmp_path, points)
    assert [float(each["square"]) for each in whole.results()] == [x**2 for x in range(60)]


def test_a_ledger_has_one_writer(tmp_path: Path) -> None:
    with Ledger(tmp_path / LEDGER), pytest.raises(InputError, match="another process"):
        run(tmp_path)
    assert len(list(run(tmp_path).results())) == 12


def test_a_damaged_result_is_not_used(tmp_path: Path) -> None:
    found = run(tmp_path)
    base = sqlite3.connect(tmp_path / LEDGER)
    base.execute("UPDATE points SET result = zeroblob(50) WHERE key = ?", (found.keys[5],))
    base.commit()
    base.close()
    with pytest.raises(InputError, match="damaged result"):
        list(run(tmp_path).results())


def test_workers_of_another_version_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from scenarios.sweep import cluster

    class Client:
        """A cluster whose second worker has another numpy."""

        def run(self, function: Any) -> dict[str, dict[str, str]]:
            """What the workers say."""
            return {"tcp://a": function(), "tcp://b": function() | {"numpy": "0.1"}}

    with pytest.raises(InputError, match=r"tcp://b: found a worker with numpy 0\.1; exp"):
        cluster._check_versions(Client(), "cluster")
