"""What can be wrong with a bench: the catalogue of effects and the worlds they make.

An `Effect` is one entry of the catalogue; a `Candidate` is an effect at one place where it can
happen, such as "thickness[0.4 mm]". `candidate.apply(world, values)` gives another `World`, which
both engines see: `EffectEngine` evaluates it by the fast engine and cached responses of the Monte
Carlo, `world_captures` by the Monte Carlo alone. `expected_intensities` says what the described
corrections would report of it.
"""

from twin.effects.accepted import accept
from twin.effects.effect import Candidate, Effect, EffectParameter
from twin.effects.engine import EffectEngine
from twin.effects.expected import expected_intensities, known_light
from twin.effects.fast import FastLight
from twin.effects.monte_carlo import world_captures
from twin.effects.readout import Readout
from twin.effects.registry import Catalogue, LeftOut, candidate, catalogue
from twin.effects.world import LIT, Alternative, Applied, Rates, Sublayer, View, World

__all__ = [
    "LIT",
    "Alternative",
    "Applied",
    "Candidate",
    "Catalogue",
    "Effect",
    "EffectEngine",
    "EffectParameter",
    "FastLight",
    "LeftOut",
    "Rates",
    "Readout",
    "Sublayer",
    "View",
    "World",
    "accept",
    "candidate",
    "catalogue",
    "expected_intensities",
    "known_light",
    "world_captures",
]
