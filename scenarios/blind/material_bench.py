"""One material on the undisturbed bench, and its visits in every arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.blind.suite import ARMS, STRONGER, Suite, maps_of, scenario_of, stream
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from scenarios.blind.visible import Drawn, Visibility
    from scenarios.scenario import Scenario
    from twin.effects import Candidate, World
    from twin.measurement import Measurement
    from twin.transport import NoiselessCaptures

MEDIUM, LIGHT, NOISE, DRAW = 1, 2, 3, 4
"""Purposes of random numbers."""
TRIES = 4
"""Draws of an arm before a material is given up."""
SINGLE_LEVELS = (8.0, 2.0, 20.0, 5.0, 12.0, 3.0, 30.0, 1.0)
"""`LEVELS` in an order that gives every few materials in a row loud and faint ones."""
LOUD = (12.0, 8.0, 20.0, 30.0)
"""Levels of all other arms: below, pairs and strangers are hardly ever separable."""
ABOVE = 1.03
"""What is asked for is a little more than the level, so that rounding leaves it visible."""


@dataclass(frozen=True, eq=False)
class MaterialBench:
    """One material on the described bench, undisturbed.

    Attributes:
        suite: that the material belongs to.
        number: of the material.
        medium: its spectra, as a scenario takes them.
        scenario: the visit as it is described, with the true material.
        nominal: the world that is as described.
        light: of that world.
        seen: what is visible beside this material.
    """

    suite: Suite
    number: int
    medium: dict[str, Any]
    scenario: Scenario
    nominal: World
    light: list[NoiselessCaptures]
    seen: Visibility

    @classmethod
    def of(cls, suite: Suite, number: int) -> MaterialBench:
        """A material of a suite, its light simulated and its signatures taken."""
        from diagnosis.translucent import translucent_case
        from scenarios.blind.light import light_of
        from scenarios.blind.materials import medium
        from scenarios.blind.visible import Visibility
        from scenarios.worlds import world_visits
        from twin.effects import Readout, World, known_light
        from twin.materials import optical_properties

        own = medium(suite.family, stream(suite, number, MEDIUM))
        scenario = scenario_of(suite, own)
        nominal = World.nominal(scenario.bench, scenario.samples)
        light = light_of(
            nominal, scenario.wavelength.wavelength_nm, suite.nominal_paths,
            _integer(stream(suite, number, LIGHT)),
        )  # fmt: skip
        visit = next(iter(world_visits(scenario, nominal, light, [0])))
        found = optical_properties(scenario.samples[0].material or "", suite.pixels_nm)
        truth = np.stack([found.albedo, found.sigma_t_per_mm, found.g], axis=-1)
        maps = maps_of(suite, scenario.bench, scenario.samples)
        case = translucent_case(
            visit, maps=maps, material=truth, paths=suite.response_paths,
            readout=known_light(nominal, Readout.of(visit)),
        )  # fmt: skip
        return cls(suite, number, own, scenario, nominal, light, Visibility(case, truth))

    def measured(self, arm: str) -> tuple[Measurement, dict[str, Any]]:
        """A visit in one arm, and what is wrong with it.

        An effect that the bench cannot have, such as a beam tilted out of the detector's sight, is
        drawn again.
        """
        for attempt in range(TRIES):
            place = self.suite.arms.index(arm) + len(ARMS) * attempt
            try:
                return self._measured(arm, place)
            except InputError as error:
                refused = error
        raise refused

    def _measured(self, arm: str, place: int) -> tuple[Measurement, dict[str, Any]]:
        from scenarios.blind.light import light_of
        from scenarios.worlds import world_visits

        drawn = self._drawn(arm, stream(self.suite, self.number, DRAW, place))
        drift = STRONGER if arm == "none" and self.number % 2 else 1.0
        scenario = self.scenario
        if drift != 1.0:
            scenario = scenario_of(self.suite, self.medium, drift=drift)
        world = replace(self.nominal, bench=scenario.bench, described_bench=scenario.bench)
        for each in drawn:
            world = each.candidate.apply(world, each.values)
        light = self.light
        if any(each.candidate.engine != "signal" for each in drawn):
            seed = _integer(stream(self.suite, self.number, LIGHT, 1 + place))
            wavelength = scenario.wavelength.wavelength_nm
            light = light_of(world, wavelength, self.suite.paths, seed)
        noise = _integer(stream(self.suite, self.number, NOISE, place))
        visit = stripped(next(iter(world_visits(scenario, world, light, [noise]))))
        return visit, self._label(arm, drawn, drift, self._seen_in(visit))

    def _seen_in(self, visit: Measurement) -> Visibility:
        """What is visible in one visit: by its own covariance, which its light decides too."""
        from diagnosis.translucent import translucent_case
        from scenarios.blind.visible import Visibility
        from twin.effects import Catalogue

        known, maps = self.seen.case, maps_of(self.suite, visit.bench, visit.samples)
        material = self.seen.material
        bare = translucent_case(visit, effects=Catalogue(()), maps=maps, material=material).problem
        if bare.channels != known.problem.channels:
            return self.seen
        own = known.problem
        problem = replace(bare, signatures=own.signatures, candidates=own.candidates)
        return Visibility(replace(known, problem=problem), material)

    def _drawn(self, arm: str, draw: np.random.Generator) -> list[Drawn]:
        """The effects of an arm with their values."""
        from scenarios.blind.outside import OUTSIDE

        if arm == "none":
            return []
        levels = SINGLE_LEVELS if arm == "single" else LOUD
        level = ABOVE * levels[self.number % len(levels)]
        if arm == "outside":
            effect = OUTSIDE[self.number % len(OUTSIDE)]
            # every effect meets every level: the level moves on when the effects start again
            turn = self.number + self.number // len(OUTSIDE)
            level = ABOVE * levels[turn % len(levels)]
            instances = effect.instances(self.nominal)
            own = effect.candidates(self.nominal)[int(draw.integers(len(instances)))]
            found = self.seen.at_level(own, level, draw)
            return [] if found is None else [found]
        if arm == "pair":
            return self._pair(level, draw)
        accept = self._ambiguous if arm == "ambiguous" else lambda drawn: True
        return [self._one(level, draw, accept)]

    def _one(
        self,
        level: float,
        draw: np.random.Generator,
        accept: Callable[[Drawn], bool],
    ) -> Drawn:
        """An effect of the catalogue at a level, each family as likely; the loudest if none is."""
        best: Drawn | None = None
        for candidate in self._shuffled(draw):
            found = self.seen.at_level(candidate, level, draw)
            if found is None:
                continue
            if found.visibility > 0.9 * level and accept(found):
                return found
            if best is None or found.visibility > best.visibility:
                best = found
        if best is None:
            raise InputError("no effect that shows at all", "one", place=f"material {self.number}")
        return best

    def _pair(self, level: float, draw: np.random.Generator) -> list[Drawn]:
        first = self._one(level, draw, lambda drawn: True)
        family = first.candidate.effect.name

        def accept(drawn: Drawn) -> bool:
            other = drawn.candidate.effect.name != family
            return other and self.seen.apart(first, drawn) > 0.7 * level

        second = self._one(level, draw, accept)
        if second.candidate.effect.name == family:
            return [first]
        # effects of the light come first, those of the signal after them, as on the bench
        return sorted([first, second], key=lambda each: each.candidate.engine == "signal")

    def _ambiguous(self, drawn: Drawn) -> bool:
        return len(self.seen.look_alikes(drawn)) > 1

    def _shuffled(self, draw: np.random.Generator) -> list[Candidate]:
        families: dict[str, list[Candidate]] = {}
        for suspect in self.seen.case.suspects:
            families.setdefault(suspect.effect.name, []).append(suspect)
        names = sorted(families)
        order = [names[i] for i in draw.permutation(len(names))]
        return [families[name][int(draw.integers(len(families[name])))] for name in order]

    def _label(
        self, arm: str, drawn: list[Drawn], drift: float, seen: Visibility
    ) -> dict[str, Any]:
        from diagnosis import TOLD_APART

        without = drawn[0].candidate.effect.name if arm == "removed" else ""
        total: FloatArray = sum(
            (each.response for each in drawn), start=np.zeros_like(self.seen.material[:, None, :])
        )
        inside = arm not in ("none", "outside", "removed")
        label: dict[str, Any] = {
            "arm": arm,
            "material": self.number,
            "drift": drift,
            "without": [without] if without else [],
            "effects": [
                {
                    "name": each.candidate.name,
                    "away": [
                        v - n for v, n in zip(each.values, each.candidate.nominal, strict=True)
                    ],
                    "visibility": float(np.linalg.norm(seen.reduced(each.response))),
                    "alike": list(seen.look_alikes(each)) if inside else [],
                }
                for each in drawn
            ],
            "response": total.tolist() if drawn else [],
            "separability": None,
            "nearest": [],
            "alike": [],
            "apart": seen.apart(*drawn) if len(drawn) == 2 else None,
        }
        if arm in ("outside", "removed") and drawn:
            names, distance = seen.nearest(total, without)
            label |= {
                "separability": distance,
                "nearest": list(names),
                "alike": list(seen.alike(total, without, TOLD_APART)),
            }
        return label


def stripped(visit: Measurement) -> Measurement:
    """The visit as a person has it: nothing of the truth, nothing of how it was made."""
    from twin.measurement import Provenance

    samples = tuple(sample.model_copy(update={"material": None}) for sample in visit.samples)
    return replace(
        visit, samples=samples, truth=None,
        provenance=Provenance(origin="simulated", software=visit.provenance.software),
    )  # fmt: skip


def _integer(generator: np.random.Generator) -> int:
    return int(generator.integers(1 << 62))
