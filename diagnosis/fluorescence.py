"""From a visit to the fluorescence bench to the problem that is diagnosed, and its diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from diagnosis.attribution import PriorOdds
from diagnosis.diagnose import ALPHA, diagnose
from diagnosis.fluorescence_model import (
    FluorescenceBench,
    Lit,
    Readings,
    Unknowns,
    material_prior,
    readings,
)
from diagnosis.problem import Channel, EffectValues, Problem
from diagnosis.refit import Fit
from diagnosis.suspects import candidate_of, judgeable
from diagnosis.verdict import Diagnosis
from twin.effects import Candidate as Suspect
from twin.effects import Catalogue, LeftOut, catalogue
from twin.errors import InputError
from twin.fluorescence.donaldson import DonaldsonMatrix
from twin.fluorescence.visit import FluorescenceVisit
from twin.spectra import FloatArray

STEP = 0.1
"""Of the differences by which signatures are taken, in prior scales."""
PASSES = 3
"""Further diagnoses about the leading effects, at most."""
TOGETHER = ("illuminant_shift",)
"""Effects that a common cause, such as a warmer room, brings to all lights at once."""

Say = Callable[[str], None]


def _silent(text: str) -> None:
    """Say nothing."""


@dataclass(frozen=True, eq=False)
class _Twin:
    """The prediction of all readings, the unknowns fitted anew for every set of effects."""

    bench: FluorescenceBench
    unknowns: Unknowns
    suspects: Mapping[str, Suspect]
    about: EffectValues

    @cached_property
    def order(self) -> np.ndarray:
        """Channels by wavelength, (K,)."""
        return np.argsort(np.asarray(self.bench.setup.detector.wavelength_nm), kind="stable")

    def spread(self, value: FloatArray) -> FloatArray:
        """Readings (..., T, J, K) as data of the problem, (..., W, M)."""
        flat = value[..., self.order].reshape(*value.shape[:-3], -1, len(self.order))
        return np.asarray(np.swapaxes(flat, -1, -2))

    def lit(self, values: EffectValues) -> Lit:
        """Lights and channels with effects at deviations from nominal."""
        return self.bench.lit(self.suspects, values)

    @cached_property
    def point(self) -> FloatArray:
        """The unknowns that the problem is linearised about, (U,)."""
        return self.unknowns.robust(self.lit(self.about))

    def fitted(self, lit: Lit) -> FloatArray:
        """The unknowns under given lights and channels, (U,).

        Where the problem is linearised about effects they stay: the modes hold their change.
        """
        return self.point if self.about else self.unknowns.fitted(lit, self.point)

    @cached_property
    def slopes(self) -> FloatArray:
        """Derivatives by the unknowns there, (U, T, J, K)."""
        return self.unknowns.slopes(self.lit(self.about), self.point)

    def forward(self, material: FloatArray, values: EffectValues) -> FloatArray:
        """Expected data (W, M); NaN for a world that cannot be.

        The unknowns' own change is taken off by its slopes: the covariance holds it.
        """
        try:
            lit = self.lit(values)
        except InputError:
            return np.full((len(self.order), self.spread(self.slopes[0]).shape[1]), np.nan)
        best = self.fitted(lit)
        moved = np.tensordot(best - self.point, self.slopes, 1)
        return self.spread(self.unknowns.expected(lit, best) - moved)

    def jacobian(self, material: FloatArray, values: EffectValues) -> FloatArray:
        """There is no free material: (W, M, 0)."""
        return np.zeros((*self.spread(self.slopes[0]).shape, 0))

    def signature(self, suspect: Suspect) -> FloatArray:
        """Change of the data per unit of every parameter at the no-effect fit, (k, W, M)."""
        rows = []
        for index, parameter in enumerate(suspect.parameters):
            ends = [0.0, 0.0] if parameter.sign != "any" else [0.0, -STEP * parameter.prior_scale]
            sign = -1.0 if parameter.sign == "negative" else 1.0
            ends[0] = sign * STEP * parameter.prior_scale
            seen = []
            for end in ends:
                away = np.zeros(len(suspect.parameters))
                away[index] = end
                seen.append(self.unknowns.expected(self.lit({suspect.name: away}), self.point))
            rows.append(self.spread((seen[0] - seen[1]) / (ends[0] - ends[1])))
        return np.array(rows)


@dataclass(frozen=True, eq=False)
class FluorescenceCase:
    """A problem and what it was made of.

    `problem.value` is the working variate about the no-effect fit: the readings, moved along the
    slopes of the unknowns from their prior mean to their fitted values, so that `problem.common`
    can hold these unknowns as modes.

    Attributes:
        problem: what `diagnose` takes: W = K channels of the detector in the order of their
            wavelengths, M = captures of white and sample under every illuminant, P = 0.
        readings: as measured.
        suspects: the catalogue's candidates in the order of `problem.candidates`.
        left_out: entries of the catalogue that could not be used, and why.
        reasons: what was masked and assumed.
        twin: predicts the readings.
    """

    problem: Problem
    readings: Readings
    suspects: tuple[Suspect, ...]
    left_out: tuple[LeftOut, ...]
    reasons: tuple[str, ...]
    twin: _Twin

    def matrix(self, values: EffectValues | None = None) -> DonaldsonMatrix:
        """The most probable matrix with effects at work (deviations from nominal), or without.

        Args:
            values: such as `diagnosis.best.values`.

        Raises:
            InputError: values that cannot be.
        """
        system = self.readings.data.system
        lit = self.twin.lit(values or {})
        unknowns = self.twin.unknowns
        found = unknowns.matrix(unknowns.fitted(lit, self.twin.point))
        return DonaldsonMatrix(
            np.where(system.emission_nm[:, None] < system.excitation_nm - 1e-6, 0.0, found),
            system.emission_nm, system.excitation_nm, name=self.readings.data.sample,
        )  # fmt: skip


def fluorescence_case(
    visit: FluorescenceVisit,
    *,
    effects: Catalogue | None = None,
    about: EffectValues | None = None,
    say: Say = _silent,
) -> FluorescenceCase:
    """The problem of a visit to the fluorescence bench, linearised about a fit.

    Args:
        visit: raw shots of dark, white and sample; corrected captures alone would not do, because
            the white of a chip is evidence too.
        effects: the catalogue; None takes ours and what is installed.
        about: effects, deviations from nominal, that the matrix is fitted with where the problem
            is linearised; None: none.
        say: told of what a person should know.

    Raises:
        InputError: the visit cannot be used as a whole.
    """
    data = readings(visit)
    bench = FluorescenceBench(visit.setup, data)
    found, left_out = _suspects(effects or catalogue(), bench)
    named = {each.name: each for each in found}
    unknowns = Unknowns(data, material_prior(data.data))
    twin = _Twin(bench, unknowns, named, {})
    if about:
        # The prior's own fit, too, has to know of the effects.
        lit = twin.lit(about)
        known = unknowns.calibrated(lit, twin.fitted(lit))
        twin = _Twin(bench, Unknowns(data, material_prior(known)), named, about)
    variance = twin.spread(data.variance)
    tested = judgeable(found, twin.signature, variance.shape, left_out=left_out, say=say)
    modes = np.concatenate([data.common, twin.slopes]).reshape(-1, data.value.size)
    if len(modes) > data.value.size:
        # The same covariance in as many modes as there are data.
        modes = np.asarray(np.linalg.qr(modes)[1])
    modes = modes.reshape(-1, *data.value.shape)
    value = data.value + np.tensordot(twin.point, twin.slopes, 1)
    channels = tuple(
        Channel(capture, name)
        for capture in data.captures
        for name in data.data.system.illuminant_names
    )
    valid = twin.spread(data.valid.astype(np.float64)) > 0.5
    size = len(channels)
    problem = Problem(
        wavelength_nm=np.asarray(visit.setup.detector.wavelength_nm, dtype=np.float64)[twin.order],
        channels=channels,
        value=np.where(valid, twin.spread(value), 0.0),
        valid=valid,
        independent=variance[:, :, None] * np.eye(size),
        common=twin.spread(modes),
        material=np.zeros((len(twin.order), 0)),
        forward=twin.forward,
        jacobian=twin.jacobian,
        signatures=tested.signatures,
        candidates=tuple(map(candidate_of, tested.suspects)),
        one_material=True,
    )
    return FluorescenceCase(problem, data, tested.suspects, tested.left_out, _reasons(data), twin)


def diagnose_fluorescence(
    visit: FluorescenceVisit,
    *,
    effects: Catalogue | None = None,
    odds: PriorOdds | None = None,
    alpha: float = ALPHA,
    seed: int = 0,
    say: Say = _silent,
) -> Diagnosis:
    """Diagnose a fluorescence visit; see `diagnosed_fluorescence`.

    Raises:
        InputError: the visit cannot be used as a whole.
    """
    return diagnosed_fluorescence(
        visit, effects=effects, odds=odds, alpha=alpha, seed=seed, say=say
    )[1]


def diagnosed_fluorescence(
    visit: FluorescenceVisit,
    *,
    effects: Catalogue | None = None,
    odds: PriorOdds | None = None,
    alpha: float = ALPHA,
    seed: int = 0,
    say: Say = _silent,
) -> tuple[FluorescenceCase, Diagnosis]:
    """Case and diagnosis of a fluorescence visit.

    The problem is linearised about the fit without effects, and where a gap is found once more
    about the fit with the leading effects: the matrix there is not bent by them.

    Args:
        visit: raw shots of dark, white and sample.
        effects: the catalogue; None takes ours and what is installed.
        odds: prior probabilities of none, singles, pairs and the unknown.
        alpha: probability of a false alarm.
        seed: of the simulations; the same seed gives the same numbers.
        say: told of what a person should know.

    Raises:
        InputError: the visit cannot be used as a whole.
    """
    case = fluorescence_case(visit, effects=effects, say=say)
    found = diagnose(case.problem, odds=odds, alpha=alpha, seed=seed)
    before: Fit | None = None
    for _ in range(PASSES):
        best = found.best
        if best is None or not best.hypothesis or _settled(before, best):
            break
        case = fluorescence_case(visit, effects=effects, about=best.values)
        found, before = diagnose(case.problem, odds=odds, alpha=alpha, seed=seed), best
    return case, found


def _settled(before: Fit | None, now: Fit) -> bool:
    """Whether the leading effects and their values are those of the diagnosis before."""
    if before is None or before.values.keys() != now.values.keys():
        return False
    moved = now.value - before.value
    return bool(np.all(np.abs(moved) <= np.sqrt(np.diag(now.covariance))))


def _suspects(
    effects: Catalogue, bench: FluorescenceBench
) -> tuple[tuple[Suspect, ...], tuple[LeftOut, ...]]:
    """Candidates of the catalogue, and those of `TOGETHER` for all lights at once."""
    found, left_out = effects.candidates(cast(Any, bench.world), "fluorescence")
    names = {each.name for each in found}
    for effect in effects.effects:
        together = Suspect(effect, "all")
        single = any(each.effect.name == effect.name for each in found)
        if effect.name in TOGETHER and single and together.name not in names:
            found = (*found, together)
    return tuple(found), tuple(left_out)


def _reasons(data: Readings) -> tuple[str, ...]:
    if data.resolved:
        words = (
            "the detector measured every light on the white: effects of the lights are taken to"
            " have come between white and sample, since what was there before is calibrated away"
        )
    else:
        words = (
            "the detector cannot measure the lights: their spectra are the nominal ones unless an"
            " effect is at work, all through the visit, and the white is evidence too"
        )
    return (*data.data.reasons, words)
