"""The stress test: estimators against a world they did not write, scored and ranked.

A plan names estimators and a design of materials, benches and noise levels; the Monte Carlo twin
simulates every point; bias, spread, coverage of the intervals and failures are reported.
"""

from __future__ import annotations

from scenarios.stress.design import Design, design_of
from scenarios.stress.parts import Case, Outcome
from scenarios.stress.plan import StressPlan, load_plan
from scenarios.stress.run import run_plan
from scenarios.stress.score import Answers, Score, score_of

__all__ = [
    "Answers",
    "Case",
    "Design",
    "Outcome",
    "Score",
    "StressPlan",
    "design_of",
    "load_plan",
    "run_plan",
    "score_of",
]
