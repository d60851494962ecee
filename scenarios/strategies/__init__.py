"""Property-based testing of estimators: random cases that shrink, and what must hold for all.

    from scenarios.strategies import property_tests

    TestMine = property_tests(lambda model: MyEstimator(model))

`check_estimator` does the same in one call. Strategies (`materials`, `benches`, `problems`, ...)
are for tests of your own. Needs hypothesis: the extra `test`.
"""

from __future__ import annotations

from importlib.util import find_spec

if find_spec("hypothesis") is None:
    raise ImportError(
        "scenarios.strategies: found no hypothesis; expected it to be installed. "
        'Run: pip install "benchtwin[test]"'
    )

from scenarios.strategies.checking import (
    Fault,
    check_estimator,
    find_faults,
    property_tests,
)
from scenarios.strategies.draws import (
    benches,
    instruments,
    materials,
    measurements,
    noises,
    problems,
)
from scenarios.strategies.effect_worlds import Effects, effects
from scenarios.strategies.problem import Make, Measured, Noise, Problem, World
from scenarios.strategies.properties import ALL, Property, PropertyFailed, Trial
from scenarios.strategies.scale import scaled_bench
from scenarios.strategies.worlds import fast_engine, monte_carlo

__all__ = [
    "ALL",
    "Effects",
    "Fault",
    "Make",
    "Measured",
    "Noise",
    "Problem",
    "Property",
    "PropertyFailed",
    "Trial",
    "World",
    "benches",
    "check_estimator",
    "effects",
    "fast_engine",
    "find_faults",
    "instruments",
    "materials",
    "measurements",
    "monte_carlo",
    "noises",
    "problems",
    "property_tests",
    "scaled_bench",
]
