"""The sim-to-real gap: where it lies, which effect causes it, how far the effect shrinks it.

`diagnose(problem)` judges a `Problem`: data with their covariance, a twin that predicts them and
a catalogue of suspects. docs/diagnosis_method.md is the statistics on one page.
"""

from diagnosis.attribution import Posterior, PriorOdds
from diagnosis.closure import Closure, closure
from diagnosis.diagnose import UNKNOWN, diagnose
from diagnosis.groups import TOLD_APART, Separations, nearest, separations
from diagnosis.next_capture import NextCapture, next_captures
from diagnosis.problem import Candidate, Channel, Extra, Problem, Smoothness
from diagnosis.reduction import Reduction
from diagnosis.refit import Fit, fit
from diagnosis.verdict import (
    Diagnosis,
    ParameterShift,
    ParameterValue,
    RankedEffect,
    Verdict,
)
from diagnosis.where import Block, Entry

__all__ = [
    "TOLD_APART",
    "UNKNOWN",
    "Block",
    "Candidate",
    "Channel",
    "Closure",
    "Diagnosis",
    "Entry",
    "Extra",
    "Fit",
    "NextCapture",
    "ParameterShift",
    "ParameterValue",
    "Posterior",
    "PriorOdds",
    "Problem",
    "RankedEffect",
    "Reduction",
    "Separations",
    "Smoothness",
    "Verdict",
    "closure",
    "diagnose",
    "fit",
    "nearest",
    "next_captures",
    "separations",
]
