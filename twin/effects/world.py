"""The world of a visit: everything that decides what is captured, beside what was written down.

A world holds two descriptions. `described_bench` and `described_samples` are what the person
wrote: the corrections of raw counts use them, whatever the truth. `bench`, `samples` and the
disturbances are what is taken for true: an effect changes these and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bench import Bench, Layer, Sample
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.effects.effect import Candidate

LIT = ("white_reference", "black_reference", "beam_reference", "black", "white", "collimated")
"""Captures with light, in the order of every array of rates."""
WHITE_REFERENCE, BLACK_REFERENCE, BEAM_REFERENCE, BLACK, WHITE, COLLIMATED = range(6)
UNDER_PANELS = (WHITE_REFERENCE, BLACK_REFERENCE, BLACK, WHITE)


@dataclass(frozen=True, eq=False)
class Rates:
    """Light on the pixels before the detector, of S samples at P wavelengths.

    Attributes:
        wavelength_nm: [nm], shape (P,).
        light: signal of every capture in the order `LIT` [electrons/s], shape (S, 6, P).
        exposure: integration time times gain of the captures [s], shape (S, 6).
        rho_white: true reflectance of the white, shape (P,).
        lamps: relative spectral power of panels and beam, shape (2, P).
    """

    wavelength_nm: FloatArray
    light: FloatArray
    exposure: FloatArray
    rho_white: FloatArray
    lamps: FloatArray

    @property
    def diffuser(self) -> FloatArray:
        """Signal of a perfect diffuser in place of the white [electrons/s], shape (S, P)."""
        return np.asarray(self.light[:, WHITE_REFERENCE] / self.rho_white)

    def scaled(self, captures: Sequence[int], factor: FloatArray | float) -> Rates:
        """The same with some captures multiplied by a factor that broadcasts to (S, P)."""
        light = self.light.copy()
        for capture in captures:
            light[:, capture] = light[:, capture] * factor
        return replace(self, light=light)


SignalStep = Callable[[Rates], Rates]
"""Something that happens to the light after the sample and before the detector: pure."""


@dataclass(frozen=True)
class Sublayer:
    """One of the layers into which the inside of a sample falls, top to bottom.

    Attributes:
        share: of the sample's thickness.
        scattering, absorption: factors on the material's coefficients.
    """

    share: float
    scattering: float = 1.0
    absorption: float = 1.0


@dataclass(frozen=True)
class Alternative:
    """Other covers for a share of the light; the rest of it meets those of the bench."""

    share: float
    covers_above: tuple[Layer, ...]
    covers_below: tuple[Layer, ...]


@dataclass(frozen=True)
class View:
    """One of the benches over which captures are averaged.

    Attributes:
        weight: in black, white and collimated.
        bench, samples: what is seen.
    """

    weight: tuple[float, float, float]
    bench: Bench
    samples: tuple[Sample, ...]


@dataclass(frozen=True)
class Applied:
    """An effect that a world has.

    Attributes:
        name: of the candidate.
        values: of its parameters.
        candidate: the candidate itself.
    """

    name: str
    values: tuple[float, ...]
    candidate: Candidate = field(compare=False, repr=False)


@dataclass(frozen=True)
class World:
    """What is taken for true, and what was written down.

    Attributes:
        bench, samples: taken for true.
        described_bench, described_samples: as written; corrections and exposures follow them.
        wedge: thickness change across each sample [mm per mm], one for each sample, or ().
        alternatives: other covers for shares of the light.
        sublayers: layers inside the samples, or () for a homogeneous inside.
        second_lobe: share and anisotropy factor of a second lobe of the phase function.
        steps: what happens to the light after the sample, in this order.
        offset_counts: counts that lit captures have and darks have not.
        shift_nm: true minus labelled wavelength of all readings [nm].
        shift_after_reference_nm: the same of captures with a sample alone [nm].
        applied: the effects that made this world, in order.
    """

    bench: Bench
    samples: tuple[Sample, ...]
    described_bench: Bench
    described_samples: tuple[Sample, ...]
    wedge: tuple[float, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    sublayers: tuple[Sublayer, ...] = ()
    second_lobe: tuple[float, float] = (0.0, 0.0)
    steps: tuple[SignalStep, ...] = ()
    offset_counts: float = 0.0
    shift_nm: float = 0.0
    shift_after_reference_nm: float = 0.0
    applied: tuple[Applied, ...] = ()

    @classmethod
    def nominal(cls, bench: Bench, samples: Sequence[Sample]) -> World:
        """The world as it is described, with the effects that were accepted into the bench.

        Raises:
            InputError: no sample, or an accepted effect that the catalogue does not know.
        """
        given = tuple(samples)
        if not given:
            raise InputError("no sample", "one sample or more", place="samples")
        plain = bench.model_copy(update={"effects": ()}) if bench.effects else bench
        world = cls(plain, given, bench, given)
        if bench.effects:
            from twin.effects.registry import candidate

            for accepted in bench.effects:
                world = candidate(world, accepted.name).apply(world, accepted.values)
        return world

    def changed(self, **fields: Any) -> World:
        """A copy with other fields."""
        return replace(self, **fields)

    def with_bench(self, **fields: Any) -> World:
        """A copy whose true bench has other fields; validated like a person's.

        Raises:
            InputError: values that no bench has.
        """
        from twin.toml import validate

        known = {name: getattr(self.bench, name) for name in type(self.bench).model_fields}
        return replace(self, bench=validate({**known, **fields}, type(self.bench)))

    def with_step(self, step: SignalStep) -> World:
        """A copy in which one more thing happens to the light after the sample."""
        return replace(self, steps=(*self.steps, step))

    @property
    def sample_keys(self) -> tuple[str, ...]:
        """How instances of effects call the samples: by thickness where that is unique."""
        texts = [f"{sample.thickness_mm:g} mm" for sample in self.described_samples]
        return tuple(
            text if texts.count(text) == 1 else sample.name
            for text, sample in zip(texts, self.described_samples, strict=True)
        )

    def views(self) -> tuple[View, ...]:
        """The benches over which captures are averaged: one, unless there is a mixture.

        A wedge spreads the thickness over a spot of radius a like a semicircle over +-a slope:
        its Gauss rule of three nodes is Chebyshev's of the second kind. Panels and beam have
        spots of their own. Light that walks sideways in the sample averages over more than the
        spot, which is left out.
        """
        both = (1.0, 1.0, 1.0)
        covered = [(1.0 - sum(each.share for each in self.alternatives), self.bench)]
        for each in self.alternatives:
            covers = {"covers_above": each.covers_above, "covers_below": each.covers_below}
            covered.append((each.share, self.bench.model_copy(update=covers)))
        thick: list[tuple[tuple[float, float, float], tuple[Sample, ...]]] = [(both, self.samples)]
        if any(self.wedge):
            detector = self.bench.detector
            beam = min(self.bench.beam.diameter_mm, detector.spot_beam_mm)
            thick = [((0.5, 0.5, 0.5), self.samples)]
            for radius, weight in (
                (detector.spot_panels_mm / 2, (0.25, 0.25, 0.0)),
                (beam / 2, (0.0, 0.0, 0.25)),
            ):
                for node in (-radius / np.sqrt(2.0), radius / np.sqrt(2.0)):
                    thick.append((weight, _thicker(self.samples, self.wedge, float(node))))
        return tuple(
            View((share * w[0], share * w[1], share * w[2]), bench, samples)
            for share, bench in covered
            if share != 0.0
            for w, samples in thick
        )


def _thicker(
    samples: tuple[Sample, ...], wedge: tuple[float, ...], node_mm: float
) -> tuple[Sample, ...]:
    changed = []
    for sample, slope in zip(samples, wedge, strict=True):
        thickness = sample.thickness_mm + slope * node_mm
        if thickness <= 0.0:
            raise InputError(
                f"a wedge of {slope:g} mm/mm in a sample {sample.thickness_mm:g} mm thick",
                "one that leaves some thickness within the spot", place=f"wedge[{sample.name}]",
            )  # fmt: skip
        changed.append(sample.model_copy(update={"thickness_mm": thickness}))
    return tuple(changed)
