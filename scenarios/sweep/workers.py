"""Who does the points: this process, processes of this machine, or a cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from scenarios.sweep.task import Answer, answer
from twin.errors import InputError

Engine = Literal["serial", "joblib", "dask"]
Job = tuple[int, str]
"""Number of a point, and the point as canonical JSON."""

INSTALL = 'Run: pip install "benchtwin[cluster]"'


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Which engine, and how many workers.

    Attributes:
        engine: "serial" (this process), "joblib" (processes of this machine) or "dask".
        count: processes; 0 takes one for each core. A scheduler of your own has its own number.
        scheduler: address of a running Dask scheduler; "" starts one on the loopback address.
        patience_s: time [s] that the scheduler has to answer.

    Raises:
        InputError: an unknown engine, a number below 0, or a scheduler for another engine.
    """

    engine: Engine = "serial"
    count: int = 0
    scheduler: str = ""
    patience_s: float = 10.0

    def __post_init__(self) -> None:
        if self.engine not in get_args(Engine):
            raise InputError(
                f'"{self.engine}"', " or ".join(f'"{e}"' for e in get_args(Engine)), place="engine"
            )
        if self.count < 0:
            raise InputError(f"{self.count} workers", "a number of 0 or more", place="workers")
        if self.scheduler and self.engine != "dask":
            raise InputError(
                f"the scheduler {self.scheduler} for the engine {self.engine}",
                'the engine "dask"',
                place="scheduler",
            )

    @property
    def processes(self) -> int:
        """How many processes of this machine work."""
        return 1 if self.engine == "serial" else self.count or os.cpu_count() or 1

    def check(self) -> None:
        """Ask a scheduler of one's own now, before long work whose points it is to get.

        Raises:
            InputError: as `answers`.
        """
        if self.scheduler:
            from scenarios.sweep.cluster import check_cluster

            check_cluster(self)

    def answers(
        self, task: str, jobs: Sequence[Job], say: Callable[[str], None] = lambda text: None
    ) -> Iterator[Answer]:
        """Answers of all jobs in the order in which they are ready.

        Args:
            task: "module:function".
            jobs: what is to be done.
            say: told about workers that died.

        Raises:
            InputError: a library is missing, a scheduler does not answer, or its workers run
                another version.
        """
        if self.engine == "serial":
            return (answer(task, number, point) for number, point in jobs)
        if self.engine == "joblib":
            from scenarios.sweep.machine import answers_of_processes

            return answers_of_processes(task, jobs, self.processes, say)
        from scenarios.sweep.cluster import answers_of_cluster

        return answers_of_cluster(task, jobs, self, say)
