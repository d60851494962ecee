"""Apply properties to an estimator: in one call, or as tests that pytest collects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from hypothesis import HealthCheck, Phase, given, note, settings
from hypothesis.errors import Flaky

from scenarios.strategies.draws import materials, problems
from scenarios.strategies.problem import Make, Problem, World
from scenarios.strategies.properties import ALL, Property, PropertyFailed, Trial
from scenarios.strategies.worlds import fast_engine
from twin.errors import InputError

EASY = ((0.3, 0.95), (0.5, 3.0), (-0.2, 0.75))
"""Albedo, sigma_t [1/mm] and g of the statistical problems."""
OPAQUE_ALBEDO = (0.3, 0.9)
"""Albedo of dense samples: nearer to 1 even they let diffuse light through."""


@dataclass(frozen=True)
class Fault:
    """A property that an estimator lacks, with the smallest problem that was found."""

    property: str
    says: str
    found: str
    problem: str

    def __str__(self) -> str:
        return f"{self.property} ({self.says})\n  {self.found}\n  {self.problem}"


def check_estimator(
    make: Make,
    properties: Sequence[Property] = ALL,
    *,
    world: World = fast_engine,
    examples: int = 10,
    wavelengths: int = 100,
    tolerance: float = 0.05,
    slack: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Try properties on an estimator.

    Args:
        make: makes the estimator for a bench.
        properties: of `ALL`.
        world: makes the measurements: `fast_engine`, `monte_carlo` or a function of yours.
        examples: problems tried for every property.
        wavelengths: of the statistical properties.
        tolerance: difference, in standard errors, of answers that count as the same; more for
            an estimator that draws random numbers.
        slack: error that is forgiven beside the stated one in albedo, sigma_t (relative), g, for
            an estimator whose theory is known to be coarse.

    Raises:
        PropertyFailed: naming every property that it lacks.
    """
    faults = find_faults(
        make,
        properties,
        world=world,
        examples=examples,
        wavelengths=wavelengths,
        tolerance=tolerance,
        slack=slack,
    )
    if faults:
        raise PropertyFailed("\n".join(map(str, faults)))


def find_faults(
    make: Make,
    properties: Sequence[Property] = ALL,
    *,
    world: World = fast_engine,
    examples: int = 10,
    wavelengths: int = 100,
    tolerance: float = 0.05,
    slack: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[Fault, ...]:
    """The properties that an estimator lacks; arguments as of `check_estimator`."""
    trial = Trial(make, world, tolerance, slack)
    found = (_try(one, trial, examples, wavelengths) for one in properties)
    return tuple(fault for fault in found if fault is not None)


def property_tests(
    make: Make,
    properties: Sequence[Property] = ALL,
    *,
    without: Sequence[str] = (),
    world: World = fast_engine,
    examples: int = 10,
    wavelengths: int = 100,
    tolerance: float = 0.05,
    slack: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> type:
    """A class of tests, one for every property; give it a name that begins with `Test`.

    Args:
        make: makes the estimator for a bench.
        properties: of `ALL`.
        without: names of properties to leave out.
        world: as of `check_estimator`, like all that follow.
        examples: problems tried for every property.
        wavelengths: of the statistical properties.
        tolerance: of answers that count as the same.
        slack: error that is forgiven.

    Raises:
        InputError: a name in `without` that no property has.
    """
    known = {one.name for one in properties}
    for name in without:
        if name not in known:
            raise InputError(f'"{name}"', f"one of {', '.join(sorted(known))}", place="without")
    trial = Trial(make, world, tolerance, slack)

    def test_of(one: Property) -> Callable[[object], None]:
        def test(self: object) -> None:
            fault = _try(one, trial, examples, wavelengths)
            if fault is not None:
                raise PropertyFailed(str(fault))

        test.__name__, test.__doc__ = f"test_{one.name}", one.says
        return test

    tests = {f"test_{one.name}": test_of(one) for one in properties if one.name not in without}
    return type("EstimatorProperties", (), tests)


def _try(one: Property, trial: Trial, examples: int, wavelengths: int) -> Fault | None:
    """Try one property; the fault is that of the smallest problem."""
    last: list[Problem] = []
    if one.statistical:
        last.append(many_materials(wavelengths))
        try:
            one.check(trial, last[-1])
        except PropertyFailed as failed:
            return Fault(one.name, one.says, str(failed), f"{wavelengths} random materials")
        return None
    material = materials(2)
    if one.optical_depth is not None:
        material = materials(2, optical_depth=one.optical_depth, albedo=OPAQUE_ALBEDO)

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    @given(problems(material=material))
    def run(problem: Problem) -> None:
        last.append(problem)
        note(f"{problem}")
        one.check(trial, problem)

    try:
        run()
    except PropertyFailed as failed:
        return Fault(one.name, one.says, str(failed), f"{last[-1]!r}")
    except Flaky:
        words = "fails and then does not fail at the same problem: the answers are not repeatable"
        return Fault(one.name, one.says, words, f"{last[-1]!r}")
    return None


def many_materials(wavelengths: int) -> Problem:
    """Independent random materials that two samples determine, one at every wavelength."""
    random = np.random.Generator(np.random.Philox(key=[0, 0x6D616E79]))
    columns = [random.uniform(low, high, wavelengths) for low, high in EASY]
    return Problem.of(np.stack(columns, axis=-1), seed=1)
