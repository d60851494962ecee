"""The fluorescent translucent case: the translucent bench lit by a set of LEDs one after another.

`Case` describes it, `true_captures` is its light by the Monte Carlo, `led_visit` and `white_visit`
are what the instrument makes of it, `compare` what the estimator recovers and what the seed's
method, blind to fluorescence, would have answered.
"""

from __future__ import annotations

from scenarios.fluorescent_translucent.case import Case, gaussian_leds
from scenarios.fluorescent_translucent.compare import Errors, compare, errors_of
from scenarios.fluorescent_translucent.designs import design_table
from scenarios.fluorescent_translucent.simulate import (
    TrueCaptures,
    led_visit,
    true_captures,
    white_visit,
)

__all__ = [
    "Case",
    "Errors",
    "TrueCaptures",
    "compare",
    "design_table",
    "errors_of",
    "gaussian_leds",
    "led_visit",
    "true_captures",
    "white_visit",
]
