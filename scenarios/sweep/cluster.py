"""Points done by a Dask cluster: a scheduler of one's own, or one on the loopback address."""

from __future__ import annotations

import contextlib
import importlib
import logging
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from scenarios.code import code_of
from scenarios.sweep.task import Answer, answer
from twin.errors import InputError

if TYPE_CHECKING:
    from scenarios.sweep.workers import Workers

PACKAGES = ("twin", "estimators", "diagnosis", "scenarios")
LIBRARIES = ("numpy", "scipy", "warp-lang", "jax", "jaxlib")
AHEAD = 4
"""Points handed out for each worker: enough to keep it busy, few enough to fit in memory."""


def versions() -> dict[str, str]:
    """What decides a result's bytes: our source and the numerical libraries, by name."""
    from importlib.metadata import version

    return {name: version(name) for name in LIBRARIES} | {"benchtwin": code_of(*PACKAGES)[:12]}


def check_cluster(workers: Workers) -> None:
    """Raise InputError unless the scheduler answers and its workers are as this process."""
    with _client(_library(), workers) as client:
        _check_versions(client, workers.scheduler or "the local cluster")


def answers_of_cluster(
    task: str, jobs: Sequence[tuple[int, str]], workers: Workers, say: Callable[[str], None]
) -> Iterator[Answer]:
    """Answers in the order in which they are ready; Dask gives a dead worker's points to others.

    Raises:
        InputError: Dask is missing, the scheduler does not answer or has no worker, or a worker
            runs another version.
    """
    distributed = _library()
    with _client(distributed, workers) as client:
        _check_versions(client, workers.scheduler or "the local cluster")
        left = iter(jobs)
        threads = sum(client.nthreads().values()) or 1

        def hand_out() -> Any:
            job = next(left, None)
            if job is None:
                return None
            future = client.submit(answer, task, *job, pure=False, retries=0)
            future.number = job[0]
            return future

        first = [future for _ in range(AHEAD * threads) if (future := hand_out()) is not None]
        under_way = distributed.as_completed(first)
        for future in under_way:
            yield _collected(future, say)
            following = hand_out()
            if following is not None:
                under_way.add(following)


def _collected(future: Any, say: Callable[[str], None]) -> Answer:
    if future.status == "finished":
        found: Answer = future.result()
        return found
    error = future.exception()
    say(f"point {future.number} was given up: {error}")
    text = f"the workers that had it died ({type(error).__name__}; out of memory?)"
    return Answer(future.number, b"", 0.0, text)


def _library() -> Any:
    from scenarios.sweep.workers import INSTALL

    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise InputError(
            f"no Dask here ({error})", "the library distributed", place="engine", remedy=INSTALL
        ) from error


@contextlib.contextmanager
def _client(distributed: Any, workers: Workers) -> Iterator[Any]:
    dask = importlib.import_module("dask")
    # Dask warns on its log about every worker that stops; what matters reaches the ledger.
    quiet = {"logging.distributed": "critical", "distributed.worker.daemon": True}
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(quiet))
        if not workers.scheduler:
            cluster = distributed.LocalCluster(
                n_workers=workers.processes, threads_per_worker=1, host="127.0.0.1",
                dashboard_address=None, silence_logs=logging.CRITICAL,
            )  # fmt: skip
            stack.enter_context(cluster)
            yield stack.enter_context(distributed.Client(cluster))
            return
        try:
            client = distributed.Client(workers.scheduler, timeout=workers.patience_s)
        except (OSError, ValueError) as error:
            raise InputError(
                f"no answer from {workers.scheduler} within {workers.patience_s:g} s ({error})",
                "a running Dask scheduler, such as tcp://10.0.0.5:8786",
                place="scheduler",
                remedy="Start one with: dask scheduler; and workers with: dask worker ADDRESS",
            ) from error
        stack.enter_context(client)
        if not client.nthreads():
            raise InputError(
                f"a scheduler without workers at {workers.scheduler}",
                "one worker or more",
                place="scheduler",
                remedy=f"Start workers with: dask worker {workers.scheduler}",
            )
        yield client


def _check_versions(client: Any, place: str) -> None:
    """Raise InputError unless all workers would compute the same bytes as this process."""
    own = versions()
    try:
        theirs: dict[str, dict[str, str]] = client.run(versions)
    except Exception as error:
        raise InputError(
            f"workers that cannot import benchtwin ({error})",
            "the same installation on every worker",
            place=place,
        ) from error
    for address, found in sorted(theirs.items()):
        other = [f"{name} {found.get(name)}" for name in own if found.get(name) != own[name]]
        if other:
            wanted = ", ".join(f"{n} {own[n]}" for n in own if found.get(n) != own[n])
            raise InputError(
                f"a worker with {', '.join(other)}",
                f"{wanted}, as here",
                place=address,
                remedy="Install the same versions on every worker.",
            )
