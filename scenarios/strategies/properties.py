"""What must hold for every estimator, as functions of an estimator and a problem.

Every property raises `PropertyFailed` with a sentence, and returns nothing where it holds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators import PARAMETERS, EstimateResult, Estimator, Status
from scenarios.strategies.effect_worlds import world_with
from scenarios.strategies.problem import Make, Measured, Noise, Problem, World
from scenarios.strategies.scale import scaled_bench
from twin.errors import InputError
from twin.spectra import FloatArray

SIGMAS = 5.5
"""Stated standard errors beyond which a wrong answer is a confident one."""
MISLED = 2.0
"""Times as far off before a misled answer counts: a misfit is said only where it shows."""
TWICE = 2.0
"""A power of two: scaled lengths are exact, so that only the estimator can differ."""


class PropertyFailed(AssertionError):
    """An estimator lacks a property."""


@dataclass(frozen=True, eq=False)
class Trial:
    """An estimator under test.

    Attributes:
        make: makes it for a bench.
        world: where its measurements come from.
        tolerance: difference in standard errors of two answers that count as the same.
        slack: difference of an answer to the truth that is forgiven for albedo, ln sigma_t, g.
    """

    make: Make
    world: World
    tolerance: float = 0.05
    slack: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def estimate(self, measured: Measured) -> EstimateResult:
        """Its answer to a measurement.

        Raises:
            PropertyFailed: it raises anything, or answers in other shapes.
        """
        try:
            estimator: Estimator = self.make(measured.model)
            result = estimator.estimate(measured.intensities)
        except Exception as error:
            raise PropertyFailed(
                f"raises {type(error).__name__}: {error}; expected a status"
            ) from error
        count = measured.model.wavelength_nm.size
        if result.parameters.shape != (count, 3) or result.status.shape != (count,):
            raise PropertyFailed(f"answers {result.status.shape} wavelengths; expected {count}")
        return result

    def measured(self, problem: Problem) -> Measured:
        """The measurement of a problem in this trial's world."""
        return problem.measured(self.world)


@dataclass(frozen=True, eq=False)
class Property:
    """A property and what problems it is tried on.

    Attributes:
        name: as in the documentation and in tables.
        says: what must hold, in a sentence.
        check: raises `PropertyFailed` where it does not.
        optical_depth: range of sigma_t [1/mm] of the problems, other than the usual one.
        statistical: tried once on many wavelengths, not on small examples.
    """

    name: str
    says: str
    check: Callable[[Trial, Problem], None]
    optical_depth: tuple[float, float] | None = None
    statistical: bool = False

    def __repr__(self) -> str:
        return self.name


def repeatable(trial: Trial, problem: Problem) -> None:
    """The same measurement gives the same answer."""
    measured = trial.measured(problem)
    one, two = trial.estimate(measured), trial.estimate(measured)
    if not (
        np.array_equal(one.parameters, two.parameters, equal_nan=True)
        and np.array_equal(one.status, two.status)
    ):
        raise PropertyFailed("the same measurement twice gives different answers")


def scale_equivariant(trial: Trial, problem: Problem) -> None:
    """All lengths twice as long, and the same captures: half of sigma_t, the same albedo and g."""
    measured = trial.measured(problem)
    samples = tuple(
        sample.model_copy(update={"thickness_mm": TWICE * sample.thickness_mm})
        for sample in problem.samples
    )
    larger = replace(problem, bench=scaled_bench(problem.bench, TWICE), samples=samples)
    other = replace(
        _unlit(larger).changed(
            value=measured.intensities.value, covariance=measured.intensities.covariance
        ),
        truth=measured.truth,
    )
    _same(
        trial,
        trial.estimate(measured),
        trial.estimate(other),
        "all lengths twice as long",
        np.array([1.0, TWICE, 1.0]),
    )


def order_of_samples(trial: Trial, problem: Problem) -> None:
    """Samples in another order give the same answer."""
    measured = trial.measured(problem)
    order = np.arange(len(problem.samples))[::-1]
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    turned = _unlit(replace(problem, samples=tuple(problem.samples[s] for s in order)))
    found = measured.intensities
    other = turned.changed(
        value=found.value[order], covariance=found.covariance[:, rows[:, None], rows]
    )
    _same(trial, trial.estimate(measured), trial.estimate(other), "samples in another order")


def opaque_ignores_background(trial: Trial, problem: Problem) -> None:
    """The answer for an opaque sample does not change with the white background."""
    measured = trial.measured(problem)
    background = problem.bench.background
    white = background.white.model_copy(update={"reflectance": 0.6})
    bench = problem.bench.model_copy(
        update={"background": background.model_copy(update={"white": white})}
    )
    other = _unlit(replace(problem, bench=bench)).changed(
        value=measured.intensities.value, covariance=measured.intensities.covariance
    )
    one, two = trial.estimate(measured), trial.estimate(other)
    claimed = _claims(one) & _claims(two)
    with np.errstate(invalid="ignore"):
        moved = np.abs(one.parameters - two.parameters) / one.standard_error
    # In truth the bench's white moves nothing; its noise in I_white - I_black may be weighed.
    if np.any(claimed & (moved > 1.0)):
        raise PropertyFailed(
            "an opaque sample over a darker white changes the answer by "
            f"{np.max(moved[claimed]):.3g} standard errors"
        )
    _near(trial, one, measured.truth)


def averages_never_widen(trial: Trial, problem: Problem) -> None:
    """Four times as many averages, and the same deviates: no interval becomes wider."""
    more = replace(problem.noise, averages=4 * problem.noise.averages)
    one = trial.estimate(trial.measured(problem))
    two = trial.estimate(trial.measured(replace(problem, noise=more)))
    few, many = (np.diff(result.interval(0.9), axis=0)[0] for result in (one, two))
    torn = (one.status == Status.INCONSISTENT) | (two.status == Status.INCONSISTENT)
    both = _claims(one) & _claims(two) & ~torn[:, None]
    wider = both & (many > few * (1.0 + trial.tolerance) + 1e-9)
    if wider.any():
        w, k = np.argwhere(wider)[0]
        raise PropertyFailed(
            f"four times as many averages widen the 90 % interval of {PARAMETERS[k]} from "
            f"{few[w, k]:.3g} to {many[w, k]:.3g}"
        )


def no_confident_wrong_answer(trial: Trial, problem: Problem) -> None:
    """What is called identifiable lies within 5.5 stated standard errors of the truth."""
    measured = trial.measured(problem)
    _near(trial, trial.estimate(measured), measured.truth)


def masked_values_do_not_matter(trial: Trial, problem: Problem) -> None:
    """Whatever stands where a capture is masked, the answer is the same."""
    measured = trial.measured(problem)
    valid = measured.intensities.valid.copy()
    valid[0, :, 0] = False
    value = measured.intensities.value
    hidden = np.where(valid, value, np.nan)
    first = trial.estimate(measured.changed(value=hidden, valid=valid))
    # One value that could be true, and one that could not.
    for stuffing in (0.9 * value, np.full_like(value, 0.9)):
        changed = measured.changed(value=np.where(valid, value, stuffing), valid=valid)
        _same(trial, first, trial.estimate(changed), "another value under a mask")


def says_when_masked(trial: Trial, problem: Problem) -> None:
    """A wavelength without a single valid capture has a status and no number."""
    measured = trial.measured(problem)
    valid = measured.intensities.valid.copy()
    valid[:, :, 0] = False
    _said(trial, measured, measured.changed(valid=valid), "every capture masked")


def says_when_not_a_number(trial: Trial, problem: Problem) -> None:
    """NaN that nobody masked, in captures or in their covariance: a status and no number."""
    measured = trial.measured(problem)
    value = measured.intensities.value.copy()
    covariance = measured.intensities.covariance.copy()
    value[:, :, 0] = np.nan
    _said(trial, measured, measured.changed(value=value), "every capture NaN")
    covariance[0] = np.nan
    _said(trial, measured, measured.changed(covariance=covariance), "every covariance NaN")


def says_when_contradictory(trial: Trial, problem: Problem) -> None:
    """Much darker over white than over black: a status and no number."""
    measured = trial.measured(problem)
    value = measured.intensities.value.copy()
    value[:, 0, 0], value[:, 1, 0] = 0.6, 0.3
    covariance = measured.intensities.covariance.copy()
    covariance[0] = np.eye(covariance.shape[1]) * 1e-4
    other = measured.changed(value=value, covariance=covariance)
    _said(trial, measured, other, "darker over white than over black")


def says_when_transmittance_above_one(trial: Trial, problem: Problem) -> None:
    """More light behind the samples than without them: a status and no number."""
    measured = trial.measured(problem)
    value = measured.intensities.value.copy()
    value[:, 2, 0] = 1.3
    covariance = measured.intensities.covariance.copy()
    covariance[0] = np.eye(covariance.shape[1]) * 1e-4
    other = measured.changed(value=value, covariance=covariance)
    _said(trial, measured, other, "a transmittance of 1.3")


def says_when_no_noise_is_stated(trial: Trial, problem: Problem) -> None:
    """A stated uncertainty of zero is said, not taken for certainty."""
    measured = trial.measured(problem)
    other = measured.changed(covariance=np.zeros_like(measured.intensities.covariance))
    result = trial.estimate(other)
    if np.any(result.status == Status.OK):
        raise PropertyFailed("captures with a stated uncertainty of zero are OK without a word")


def says_when_thickness_is_missing(trial: Trial, problem: Problem) -> None:
    """A thickness that is NaN: the clear error of the whole, or no number at all."""
    measured = trial.measured(problem)
    thickness = measured.intensities.thickness_mm.copy()
    thickness[-1] = np.nan
    try:
        result = trial.make(measured.model).estimate(
            measured.changed(thickness_mm=thickness).intensities
        )
    except InputError:
        return
    except Exception as error:
        raise PropertyFailed(f"raises {type(error).__name__}; expected InputError") from error
    if np.any(result.status == Status.OK):
        raise PropertyFailed("a sample without a thickness is used without a word")


def says_when_misled(trial: Trial, problem: Problem) -> None:
    """The thickest sample half as thick again as stated: no answer far from the truth is OK.

    No material explains all samples then. An answer may bear with it (wide intervals), or say so.
    It is the thickest because that may be too dense to tell anything: what is left is right then.
    """
    thickest = int(np.argmax([sample.thickness_mm for sample in problem.samples]))
    key = world_with(problem.bench, problem.samples, {}).sample_keys[thickest]
    thicker = {f"thickness[{key}]": {"relative": 0.5}}
    measured = trial.measured(replace(problem, effects=thicker))
    result = trial.estimate(measured)
    unsaid = _claims(result) & (result.status == Status.OK)[:, None]
    wrong = unsaid & _off(trial, result, measured.truth, MISLED * SIGMAS)
    if wrong.any():
        w, k = np.argwhere(wrong)[0]
        raise PropertyFailed(
            f"a sample 50 % thicker than stated: {PARAMETERS[k]} is said to be "
            f"{result.parameters[w, k]:.5g} +- {result.standard_error[w, k]:.2g}, is "
            f"{measured.truth[w, k]:.5g}, and the status is OK"
        )


def intervals_cover(trial: Trial, problem: Problem) -> None:
    """Intervals of 50 and 90 % hold the truth as often as they say, and not when noise is hidden.

    The margin is 4.5 standard deviations of the count. The control states half of the noise: an
    estimator whose intervals still cover then does not look at the noise.
    """
    shots = replace(problem, noise=Noise(relative=0.03, averages=9))
    measured = trial.measured(shots)
    result = trial.estimate(measured)
    counted = _claims(result) & (result.status < Status.INCONSISTENT)[:, None]
    if not counted.any():
        raise PropertyFailed("no parameter is identifiable at any wavelength of an easy problem")
    for level in (0.5, 0.9):
        for k, (share, margin) in enumerate(_coverage(result, measured.truth, counted, level)):
            low, high = level - margin - 0.03, level + 0.75 * (1.0 - level) + margin
            if not low <= share <= high:
                raise PropertyFailed(
                    f"{level:.0%} intervals of {PARAMETERS[k]} hold the truth at {share:.1%} of "
                    f"{counted[:, k].sum()} wavelengths"
                )
    hidden = trial.measured(replace(shots, noise=replace(shots.noise, understated=2.0)))
    control = trial.estimate(hidden)
    counted = _claims(control) & (control.status < Status.INCONSISTENT)[:, None]
    fooled = [
        share < 0.9 - margin
        for share, margin in _coverage(control, hidden.truth, counted, 0.9)
        if margin < 0.3
    ]
    if fooled and not any(fooled):
        raise PropertyFailed("90 % intervals cover even where half of the noise is hidden")


def _coverage(
    result: EstimateResult, truth: FloatArray, counted: NDArray[np.bool_], level: float
) -> list[tuple[float, float]]:
    """Share of intervals that hold the truth and its margin, for each counted parameter."""
    low, high = result.interval(level)
    held = (low <= truth) & (truth <= high)
    found = []
    for k in range(3):
        number = int(counted[:, k].sum())
        margin = 4.5 * np.sqrt(level * (1.0 - level) / max(number, 1))
        share = float(held[counted[:, k], k].mean()) if number else level
        found.append((share, float(margin)))
    return found


def _unlit(problem: Problem) -> Measured:
    """A problem's bench without light: its captures come from another problem."""
    return problem.measured(lambda model, material: np.zeros((len(model.n), 3, len(material))))


def _claims(result: EstimateResult) -> NDArray[np.bool_]:
    """Where a number is given as one to be used, shape (W, 3)."""
    has_value = np.repeat((result.status < Status.OUTSIDE_MAP)[:, None], 3, axis=1)
    # That status says in words that sigma_t is a lower bound.
    has_value[:, 1] &= result.status != Status.COLLIMATED_LOST
    return np.asarray(result.identifiable & has_value & np.isfinite(result.parameters))


def _same(
    trial: Trial,
    one: EstimateResult,
    two: EstimateResult,
    what: str,
    scale: FloatArray | None = None,
) -> None:
    factor = np.ones(3) if scale is None else scale
    if not np.array_equal(_claims(one).any(axis=1), _claims(two).any(axis=1)):
        raise PropertyFailed(
            f"{what}: identifiable at {_claims(one).any(axis=1).sum()} wavelengths, then at "
            f"{_claims(two).any(axis=1).sum()}"
        )
    both = _claims(one) & _claims(two)
    with np.errstate(invalid="ignore"):
        difference = np.abs(one.parameters - factor * two.parameters)
        error = np.where(np.isfinite(one.standard_error), one.standard_error, 0.0)
        most = trial.tolerance * error + 1e-6 * (1.0 + np.abs(one.parameters))
    wrong = both & ~(difference <= most)
    if wrong.any():
        w, k = np.argwhere(wrong)[0]
        raise PropertyFailed(
            f"{what}: {PARAMETERS[k]} changes from {one.parameters[w, k]:.6g} to "
            f"{factor[k] * two.parameters[w, k]:.6g}; expected the same"
        )


def _off(
    trial: Trial, result: EstimateResult, truth: FloatArray, sigmas: float
) -> NDArray[np.bool_]:
    """Values further from the truth than that, beyond what is forgiven, shape (W, 3)."""
    scale = np.stack([np.ones(len(truth)), truth[:, 1], np.ones(len(truth))], axis=-1)
    with np.errstate(invalid="ignore"):
        allowed = sigmas * result.standard_error + np.array(trial.slack) * scale + 1e-9
        return np.asarray(~(np.abs(result.parameters - truth) <= allowed))


def _near(trial: Trial, result: EstimateResult, truth: FloatArray) -> None:
    wrong = _claims(result) & _off(trial, result, truth, SIGMAS)
    if wrong.any():
        w, k = np.argwhere(wrong)[0]
        raise PropertyFailed(
            f"{PARAMETERS[k]} is said to be {result.parameters[w, k]:.5g} +- "
            f"{result.standard_error[w, k]:.2g} and is {truth[w, k]:.5g}"
        )


def _said(trial: Trial, good: Measured, spoiled: Measured, what: str) -> None:
    before, after = trial.estimate(good), trial.estimate(spoiled)
    if after.status[0] == Status.OK:
        raise PropertyFailed(f"{what}: the status is OK; expected one that says so")
    if _claims(after)[0].any():
        raise PropertyFailed(
            f"{what}: the status is {Status(int(after.status[0])).name}, yet "
            f"{after.parameters[0]} is called identifiable"
        )
    if after.status[0] > Status.OUTSIDE_MAP and np.isfinite(after.parameters[0]).any():
        raise PropertyFailed(f"{what}: {after.parameters[0]} is given; expected NaN")
    lost = _claims(before)[1:].any(axis=1) & ~_claims(after)[1:].any(axis=1)
    if lost.any():
        raise PropertyFailed(f"{what} at one wavelength spoils {lost.sum()} others")


ALL: tuple[Property, ...] = tuple(
    Property(
        check.__name__,
        (check.__doc__ or "").split("\n")[0],
        check,
        optical_depth=(60.0, 80.0) if check is opaque_ignores_background else None,
        statistical=check is intervals_cover,
    )
    for check in (
        repeatable,
        scale_equivariant,
        order_of_samples,
        opaque_ignores_background,
        averages_never_widen,
        no_confident_wrong_answer,
        intervals_cover,
        masked_values_do_not_matter,
        says_when_masked,
        says_when_not_a_number,
        says_when_contradictory,
        says_when_transmittance_above_one,
        says_when_misled,
        says_when_no_noise_is_stated,
        says_when_thickness_is_missing,
    )
)
"""Every property, the quick ones first."""
