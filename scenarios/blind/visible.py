"""How loud an effect is in a measurement once the material has followed, and the values for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from diagnosis import Reduction, nearest, separations
from diagnosis.evidence import Hypothesis, Scores, hypotheses, turned_scales
from diagnosis.translucent import TranslucentCase, coordinates
from scenarios.blind.outside import MISLABELLED, response_of_mislabelled
from twin.effects import Candidate
from twin.errors import InputError
from twin.spectra import FloatArray

CAP = 3.0
"""Prior scales beyond which no effect is made, however faint it is."""
CORRECTIONS = 2
"""Steps by which the values are corrected for an effect that is not linear."""


@dataclass(frozen=True)
class Drawn:
    """An effect with its values.

    Attributes:
        candidate: the effect.
        values: of its parameters.
        visibility: standard deviations that it moves the reduced data by.
        response: change of the expected intensities, (W, S, 3).
    """

    candidate: Candidate
    values: tuple[float, ...]
    visibility: float
    response: FloatArray


@dataclass(frozen=True, eq=False)
class Visibility:
    """What can be seen of effects beside one material, by the signatures at the true material.

    Attributes:
        case: of an undisturbed visit; its signatures were taken at `material`.
        material: the truth, albedo, sigma_t [1/mm] and g, (W, 3).
    """

    case: TranslucentCase
    material: FloatArray

    @cached_property
    def reduction(self) -> Reduction:
        """Whitened, the material taken off."""
        problem = self.case.problem
        return Reduction.of(problem, problem.jacobian(coordinates(*self.material.T), {}))

    @cached_property
    def columns(self) -> FloatArray:
        """Reduced signatures in prior scales, (n, E)."""
        problem = self.case.problem
        factor = turned_scales(problem.candidates)[0]
        return self.reduction(np.moveaxis(problem.signatures, 0, -1)) * factor

    @cached_property
    def scores(self) -> Scores:
        """Of no residual at all: its gram is what matters."""
        problem, columns = self.case.problem, self.columns
        positive = turned_scales(problem.candidates)[1]
        gram = columns.T @ columns
        return Scores(gram, np.zeros((1, len(gram))), positive, problem.columns)

    @cached_property
    def names(self) -> list[str]:
        """Of the catalogue's candidates."""
        return [each.name for each in self.case.suspects]

    def reduced(self, response: FloatArray) -> FloatArray:
        """A change of intensities (W, S, 3) in all repeats, reduced, (n,)."""
        return self.reduction(expanded(self.case, response))

    def response(self, candidate: Candidate, values: tuple[float, ...]) -> FloatArray:
        """Change of the expected intensities, (W, S, 3)."""
        engine = self.case.engine
        if candidate.effect is MISLABELLED:
            return response_of_mislabelled(
                engine, candidate.instance, self.material, float(values[0])
            )
        return engine.response(candidate, self.material, values)

    def at_level(
        self, candidate: Candidate, level: float, stream: np.random.Generator
    ) -> Drawn | None:
        """An effect as loud as asked for, or as its cap allows; None where it cannot be.

        Args:
            candidate: of the catalogue or not.
            level: standard deviations.
            stream: draws the direction of several parameters, and signs.
        """
        own = candidate.parameters
        turn = np.array([-1.0 if p.sign == "negative" else 1.0 for p in own])
        free = np.array([p.sign == "any" for p in own])
        direction = stream.standard_normal(len(own)) if len(own) > 1 else np.ones(1)
        direction = np.where(free, direction, np.abs(direction))
        if len(own) == 1 and free[0] and stream.random() < 0.5:
            direction = -direction
        direction = direction / np.max(np.abs(direction))
        scale = np.array([p.prior_scale for p in own])
        nominal = np.array(candidate.nominal)
        reach = min([CAP, *(0.99 * p.limit / p.prior_scale for p in own)])
        power = 2.0 if any(p.even for p in own) else 1.0
        size = min(1.0, reach)
        for _ in range(1 + CORRECTIONS):
            values = tuple((nominal + turn * direction * scale * size).tolist())
            try:
                response = self.response(candidate, values)
            except InputError:
                return None
            seen = float(np.linalg.norm(self.reduced(response)))
            if not np.isfinite(seen) or seen <= 0.0:
                return None
            found = Drawn(candidate, values, seen, response)
            wanted = min(reach, size * (level / seen) ** (1.0 / power))
            if abs(wanted / size - 1.0) < 0.02:
                break
            size = wanted
        return found

    def look_alikes(self, drawn: Drawn) -> tuple[str, ...]:
        """Candidates that an effect of the catalogue may be taken for, itself first."""
        index = self.names.index(drawn.candidate.name)
        problem = self.case.problem
        factor = turned_scales(problem.candidates)[0][list(problem.columns[index])]
        away = np.array(drawn.values) - np.array(drawn.candidate.nominal)
        between = separations(self.scores, {index: away / factor})
        group = between.group(index, list(range(len(self.names))))
        return tuple(self.names[i] for i in group)

    def nearest(self, response: FloatArray, without: str = "") -> tuple[tuple[str, ...], float]:
        """The effect or pair of the catalogue that comes nearest to a signal, and how far it is.

        Args:
            response: change of the expected intensities, (W, S, 3).
            without: an effect that is taken out.
        """
        problem = self.case.problem
        kept = [i for i, c in enumerate(problem.candidates) if c.effect != without]
        tested: list[Hypothesis] = hypotheses(kept)
        best, distance = nearest(self.scores, self.reduced(response), self.columns, tested)
        return tuple(self.names[i] for i in best), distance

    def alike(self, response: FloatArray, without: str, told_apart: float) -> tuple[str, ...]:
        """Single effects that come nearer to a signal than can be told apart."""
        target, problem = self.reduced(response), self.case.problem
        found = []
        for index, candidate in enumerate(problem.candidates):
            if candidate.effect != without:
                away = nearest(self.scores, target, self.columns, [(index,)])[1]
                if away < told_apart:
                    found.append(self.names[index])
        return tuple(found)

    def apart(self, one: Drawn, other: Drawn) -> float:
        """What is left of the fainter of two effects beside the other, in standard deviations."""
        pair = np.stack([self.reduced(each.response) for each in (one, other)])
        (a, c), (_, b) = pair @ pair.T
        sine = 1.0 - c**2 / max(a * b, 1e-300)
        return float(np.sqrt(max(min(a, b) * sine, 0.0)))


def expanded(case: TranslucentCase, response: FloatArray) -> FloatArray:
    """A change (W, S, 3) in the channels of a problem, the same in every repeat, (W, M)."""
    samples = [sample.name for sample in case.engine.world.described_samples]
    place = [
        3 * samples.index(c.sample) + ("black", "white", "collimated").index(c.capture)
        for c in case.problem.channels
    ]
    return np.asarray(response.reshape(len(response), -1)[:, place])
