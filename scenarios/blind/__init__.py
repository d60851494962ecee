"""The sealed check: measurements whose effect is withheld until the diagnosis has spoken.

`make` simulates measurements by the Monte Carlo bench and seals what is wrong with each, `run`
diagnoses them without looking, `open_seals` proves that nothing was changed meanwhile, and `score`
counts right and wrong. docs/blind.md tells how to read the figures.
"""

from scenarios.blind.make import make
from scenarios.blind.run import run
from scenarios.blind.score import score
from scenarios.blind.seal import open_seals
from scenarios.blind.suite import ARMS, LEVELS, Suite
from scenarios.blind.table import table

__all__ = ["ARMS", "LEVELS", "Suite", "make", "open_seals", "run", "score", "table"]
