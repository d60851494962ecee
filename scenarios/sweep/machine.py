"""Points done by processes of this machine, through joblib."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from scenarios.sweep.task import Answer, answer

DEATHS = 3
"""How often a point may be under way when a worker dies before it counts as the cause."""


def answers_of_processes(
    task: str, jobs: Sequence[tuple[int, str]], processes: int, say: Callable[[str], None]
) -> Iterator[Answer]:
    """Answers in the order in which they are ready; the death of a worker is survived.

    joblib does not tell which worker died: every point that was under way is tried again, alone
    the third time, and the one that kills its worker even then is answered with a message.
    """
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    waiting = dict(jobs)
    deaths: dict[int, int] = {}
    while waiting:
        suspect = [number for number in waiting if deaths.get(number, 0) >= DEATHS - 1]
        batch = suspect[:1] or list(waiting)
        started: set[int] = set()
        try:
            for found in _batch(task, [(n, waiting[n]) for n in batch], processes, started):
                del waiting[found.number]
                yield found
        except TerminatedWorkerError:
            under_way = started.intersection(waiting)
            say(f"a worker died; the {len(under_way)} points that were under way are tried again")
            for number in sorted(under_way):
                deaths[number] = deaths.get(number, 0) + 1
                if deaths[number] >= DEATHS:
                    del waiting[number]
                    text = f"the process that worked on it died {DEATHS} times (out of memory?)"
                    yield Answer(number, b"", 0.0, text)


def _batch(
    task: str, jobs: Sequence[tuple[int, str]], processes: int, started: set[int]
) -> Iterator[Answer]:
    from joblib import Parallel, delayed

    def calls() -> Iterator[object]:
        for number, point in jobs:
            started.add(number)
            yield delayed(answer)(task, number, point)

    run = Parallel(
        n_jobs=processes, backend="loky", return_as="generator_unordered", batch_size=1,
        pre_dispatch=2 * processes,
    )  # fmt: skip
    yield from run(calls())
