"""Sweeps: one function over many points, on one machine or a cluster, resumable.

`sweep` calls a task, named as "module:function", at every point and keeps each result in a ledger
on disk as soon as it is there. Whatever the engine and the number of workers, the results are the
same bytes; a killed sweep goes on where it was.
"""

from scenarios.sweep.ledger import Failure, Ledger
from scenarios.sweep.run import Sweep, finished, sweep
from scenarios.sweep.task import Timed
from scenarios.sweep.workers import Engine, Workers

__all__ = ["Engine", "Failure", "Ledger", "Sweep", "Timed", "Workers", "finished", "sweep"]
