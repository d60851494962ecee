"""The same seed gives the same bytes for any number of threads, chunks and processes."""

from __future__ import annotations

import hashlib
import threading
from typing import Any

import numpy as np
import pytest

from tests.contract.repository import run_python
from tests.transport.scenes import BARE, slab
from twin.bench import Bench, Medium, Sample
from twin.transport import Effort, Tallies, captures, engine, panels_setup, run_many, trace

EFFORT = Effort(blocks=16, log2_paths=6)
STACK = slab(2.0, 0.5, 1.4)


def traced(seed: int = 21, blocks: int = 16, first_block: int = 0) -> Tallies:
    return trace(
        STACK,
        panels_setup(BARE, 1.0),
        Effort(blocks=blocks, log2_paths=6),
        seed=seed,
        first_block=first_block,
    )


def test_chunks_are_parts_of_the_whole() -> None:
    whole = traced().value
    parts = [traced(blocks=5).value, traced(blocks=11, first_block=5).value]
    np.testing.assert_array_equal(whole, np.concatenate(parts))
    assert not np.array_equal(whole[:5], parts[1][:5])


def test_a_long_trace_in_several_launches_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = traced().value
    monkeypatch.setattr(engine, "PATHS_OF_A_LAUNCH", 5 << 6)
    np.testing.assert_array_equal(whole, traced().value)


def test_an_interrupt_ends_a_long_trace_between_its_launches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(engine, "PATHS_OF_A_LAUNCH", 1 << 6)
    launched: list[int] = []
    real = engine._launch
    halfway, go_on = threading.Event(), threading.Event()

    def counted(*arguments: Any) -> Tallies:
        launched.append(len(launched))
        if len(launched) == 4:
            halfway.set()
            go_on.wait(30.0)
        return real(*arguments)

    def interrupt() -> None:
        halfway.wait(30.0)
        threading.Timer(0.2, go_on.set).start()
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, "_launch", counted)
    with pytest.raises(KeyboardInterrupt):
        run_many([interrupt, traced], threads=2)
    assert len(launched) == 4  # of 16
    assert len(run_many([traced], threads=2)) == 1  # the control: the next run is not stopped
    assert len(launched) == 4 + 16


def test_threads_change_nothing() -> None:
    def jobs() -> list:
        return [lambda seed=seed: traced(seed).value for seed in range(6)]

    one, three = run_many(jobs(), threads=1), run_many(jobs(), threads=3)
    np.testing.assert_array_equal(one, three)
    assert not np.array_equal(one[0], one[1])


def test_another_process_computes_the_same_bytes() -> None:
    script = (
        "import hashlib; from tests.transport.test_same_bytes import traced; "
        "print(hashlib.sha256(traced().value.tobytes()).hexdigest())"
    )
    finished = run_python("-c", script)
    assert finished.stdout.split()[-1] == hashlib.sha256(traced().value.tobytes()).hexdigest()


def test_captures_do_not_depend_on_threads() -> None:
    medium = Medium(albedo=0.9, sigma_t_per_mm=2.0, g=0.6)
    sample = Sample(name="sample", thickness_mm=1.0, material=medium)
    wavelength = np.array([500.0, 600.0])

    def run(threads: int, seed: int = 1) -> np.ndarray:
        result = captures(Bench(), sample, wavelength, paths=4096, seed=seed, threads=threads)
        return np.stack([result.black, result.white, result.collimated, result.white_se])

    np.testing.assert_array_equal(run(1), run(2))
    assert not np.array_equal(run(1), run(1, seed=2))
