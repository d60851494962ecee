"""What the effects of the catalogue at their usual sizes would do to a candidate.

An effect that the estimate does not know moves it by F^-1 [J M]' N^-1 s, with s its signature; the
root sum of squares of all of them joins the predicted uncertainty. What an effect leaves in the
captures once material and tolerances have followed says whether a diagnosis can find it, and tell
it from the others (`diagnosis.TOLD_APART`); no smoothness of the spectra is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diagnosis import TOLD_APART
from scenarios.design.candidate import Candidate
from scenarios.design.fisher import Information, prior_widths
from scenarios.design.modes import UNSEEN, Modes, is_private, modes
from scenarios.design.noise import covariance
from scenarios.design.optics import MATERIAL
from scenarios.design.parts import Parts
from scenarios.design.predictor import COLUMN, TranslucentPredictor
from twin.spectra import FloatArray

LEFT_OUT = ("extra_covers", "missing_covers", "phase_function", "wedge", "thickness", "bandwidth")
"""Effects that need programs of their own, or that tolerances say already."""


@dataclass(frozen=True, eq=False)
class Robustness:
    """A candidate among the effects of the catalogue.

    Attributes:
        candidate: which.
        figures: predicted, and with all effects at their prior scales, by target.
        effects: by name: change of the figure's parameter (root mean square over the wavelengths
            of the worst material) by target, and strength in standard deviations.
        apart: pairs of visible effects that cannot be told apart.
        hidden: effects that these captures do not show.
        next_mm: thickness that would tell most effects apart, and how many more; None: none helps.
        unseen: effects that were not looked at: the Monte Carlo alone sees them.
    """

    candidate: Candidate
    figures: dict[str, tuple[float, float]]
    effects: dict[str, tuple[dict[str, float], float]]
    apart: tuple[tuple[str, str], ...]
    hidden: tuple[str, ...]
    next_mm: tuple[float, int] | None
    unseen: tuple[str, ...]

    def as_json(self, parts: Parts) -> dict[str, Any]:
        """For the JSON file."""
        return {
            "id": self.candidate.id(parts),
            "figures": {
                n: {"predicted": a, "with_effects": b} for n, (a, b) in self.figures.items()
            },
            "effects": {n: {"moves": a, "strength": b} for n, (a, b) in self.effects.items()},
            "not_told_apart": [list(pair) for pair in self.apart],
            "hidden": list(self.hidden),
            "next_thickness_mm": None if self.next_mm is None else self.next_mm[0],
            "unseen": list(self.unseen),
        }


def robustness(predictor: TranslucentPredictor, candidate: Candidate) -> Robustness:
    """A candidate among the effects of the catalogue at their prior scales.

    Raises:
        InputError: a candidate that cannot be.
    """
    names, scales, unseen = _effects(predictor)
    setting = predictor.setting(candidate)
    light = setting.light
    own = modes(names, predictor.optics, setting.bench, setting.settings, light, setting.view)
    noise = covariance(
        setting.settings, light.value, averages=candidate.averages, repeats=candidate.repeats
    )
    known = setting.modes
    joined = Modes(
        known.common, known.private,
        np.concatenate([known.array, own.array * np.array(scales)], axis=-1),
    )  # fmt: skip
    material = np.array([medium.at(setting.wavelength_nm) for medium in predictor.media])
    thick = predictor.optics.thickness_mm
    whole = Information.of(light, noise, joined, material, np.array(thick))
    chosen = [thick.index(mm) for mm in candidate.thickness_mm]
    tolerance = predictor.scales(candidate)
    shift, gram = _left(whole, chosen, tolerance, len(names))
    strength = np.sqrt(np.maximum(np.diagonal(gram), 0.0))
    seen = [i for i in range(len(names)) if strength[i] >= TOLD_APART]
    pairs = _confused(gram, seen)
    effects = {
        name: (_moves(predictor, shift[..., i], material), float(strength[i]))
        for i, name in enumerate(names)
    }
    plain = dict(zip(predictor.targets, predictor.predict([candidate])[0].tolist(), strict=True))
    figures = {}
    for name, value in plain.items():
        extra = [moved.get(name, 0.0) for moved, _ in effects.values()]
        figures[name] = (value, float(np.sqrt(value**2 + np.sum(np.square(extra)))))
    return Robustness(
        candidate, figures, effects,
        tuple((names[i], names[j]) for i, j in pairs),
        tuple(names[i] for i in range(len(names)) if i not in seen),
        _next(whole, chosen, tolerance, len(names), len(seen) - _members(pairs), thick),
        unseen,
    )  # fmt: skip


def _effects(predictor: TranslucentPredictor) -> tuple[list[str], list[float], tuple[str, ...]]:
    """Names and prior scales of effects that no part has a tolerance of, and those unseen."""
    from twin.effects import catalogue

    known = {name.partition(".")[0].partition("[")[0] for name in predictor.common}
    known |= {"aperture", "refractive_index", "black_level", "white_ageing"}
    names, scales, unseen = [], [], []
    for effect in catalogue().effects:
        if effect.visit != "translucent" or effect.name in LEFT_OUT or effect.name in known:
            continue
        if effect.engine == UNSEEN:
            unseen.append(effect.name)
            continue
        instances = {"drift": ("black", "white", "collimated"), "wavelength_shift": ("all",)}
        for instance in instances.get(effect.name, ("",)):
            first = effect.parameters[0]
            name = f"{effect.name}[{instance}]" if instance else effect.name
            if is_private(name):
                continue
            names.append(name)
            scales.append(first.prior_scale)
    return names, scales, tuple(unseen)


def _left(
    whole: Information, chosen: Sequence[int], tolerance: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Shift of the material by every effect (M, W, 3, E), and what they leave, (E, E)."""
    common, private = len(whole.common), len(whole.private)
    size = MATERIAL + common + len(chosen) * private
    shape = whole.material.shape[:2]
    known = np.zeros((*shape, size, size))
    cross = np.zeros((*shape, size, count))
    rest = np.zeros((*shape, count, count))
    factor = np.concatenate([np.ones(MATERIAL), tolerance, np.ones(count)])
    last = MATERIAL + common + private
    for slot, k in enumerate(chosen):
        tail = MATERIAL + common + slot * private + np.arange(private)
        rows = np.concatenate([np.arange(MATERIAL + common), tail])
        part = whole.matrix[:, k] * factor[:, None] * factor
        known[:, :, rows[:, None], rows] += part[..., :last, :last]
        cross[:, :, rows] += part[..., :last, last:]
        rest += part[..., last:, last:]
    wide = prior_widths([whole], [chosen])[0]
    width = np.concatenate([wide, np.ones((*shape, size - MATERIAL))], axis=-1)
    scaled = known * width[..., :, None] * width[..., None, :] + np.eye(size)
    solved = np.linalg.solve(scaled, cross * width[..., None])
    shift = (solved * width[..., None])[..., :MATERIAL, :]
    explained = np.einsum("mwpe,mwpf->mwef", cross * width[..., None], solved)
    return shift, np.asarray((rest - explained).sum(axis=(0, 1)))


def _confused(gram: FloatArray, seen: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of visible effects of which one may be taken for the other."""
    found = []
    for place, i in enumerate(seen):
        for j in seen[place + 1 :]:
            alike = gram[i, j] ** 2 / max(gram[j, j], 1e-30)
            if gram[i, i] - alike < TOLD_APART**2:
                found.append((i, j))
    return found


def _members(pairs: Sequence[tuple[int, int]]) -> int:
    return len({each for pair in pairs for each in pair})


def _next(
    whole: Information, chosen: Sequence[int], tolerance: FloatArray, count: int, now: int,
    thick: Sequence[float],
) -> tuple[float, int] | None:  # fmt: skip
    """The further thickness with which most effects are seen and told apart."""
    best: tuple[float, int] | None = None
    for k, mm in enumerate(thick):
        if k in chosen:
            continue
        gram = _left(whole, [*chosen, k], tolerance, count)[1]
        seen = [i for i in range(count) if gram[i, i] >= TOLD_APART**2]
        more = len(seen) - _members(_confused(gram, seen)) - now
        if more > 0 and (best is None or more > best[1]):
            best = (mm, more)
    return best


def _moves(
    predictor: TranslucentPredictor, shift: FloatArray, material: FloatArray
) -> dict[str, float]:
    """Change of albedo, sigma_t and g by one effect, root mean square, worst material."""
    found = {}
    for name in predictor.targets:
        if name not in COLUMN:
            continue
        values = shift[..., COLUMN[name]]
        if name == "sigma_t_relative":
            values = values / material[..., 1]
        found[name] = float(np.sqrt(np.mean(values**2, axis=-1)).max())
    return found
