"""One case for an estimator: a bench, a material by wavelength, noise; and its measurement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from estimators import BenchModel, Estimator
from scenarios.strategies.effect_worlds import Effects, captures_with, world_with
from twin.bench import Bench, Sample
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

Make = Callable[[BenchModel], Estimator]
"""Makes the estimator that is tested, for any bench."""
World = Callable[[BenchModel, FloatArray], FloatArray]
"""From a bench and a material (W, 3) to exact captures (S, 3, W): what is taken for true."""


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of every capture, independent of all others."""

    relative: float = 0.01
    """Standard deviation of one shot over the capture."""
    floor: float = 1e-4
    """Least standard deviation [1] of one shot."""
    averages: int = 1
    """Shots that are averaged."""
    understated: float = 1.0
    """How many times larger the noise is than the stated one."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What an estimator is given, and the truth that it must not see.

    Attributes:
        model: what is known of the bench.
        intensities: relative intensities of S samples at W wavelengths.
        truth: albedo, sigma_t [1/mm] and g, shape (W, 3).
    """

    model: BenchModel
    intensities: RelativeIntensities
    truth: FloatArray

    def changed(self, **fields: object) -> Measured:
        """The same with other fields of the relative intensities."""
        return replace(self, intensities=replace(self.intensities, **fields))  # type: ignore[arg-type]

    def __repr__(self) -> str:
        shown = [
            f"{name} {np.array2string(values, precision=4, separator=', ', legacy=False)}"
            for name, values in (
                ("thickness [mm]", self.intensities.thickness_mm),
                ("albedo", self.truth[:, 0]),
                ("sigma_t [1/mm]", self.truth[:, 1]),
                ("g", self.truth[:, 2]),
                ("captures", np.round(self.intensities.value, 5)),
            )
        ]
        return "\n  ".join(["Measured(", *shown]) + ")"


@dataclass(frozen=True, eq=False)
class Problem:
    """A bench, samples of one material, and noise.

    Attributes:
        bench: the bench.
        samples: S samples that differ in thickness.
        wavelength_nm: wavelengths [nm], shape (W,).
        material: albedo, sigma_t [1/mm] and g, shape (W, 3).
        noise: of the captures.
        seed: of the noise: the same seed gives the same deviates at every noise level.
        effects: what is true and not told, see `scenarios.strategies.effect_worlds`.
    """

    bench: Bench
    samples: tuple[Sample, ...]
    wavelength_nm: FloatArray
    material: FloatArray
    noise: Noise = Noise()
    seed: int = 0
    effects: Effects = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        material: Sequence[Sequence[float]] | FloatArray,
        *,
        bench: Bench | None = None,
        thickness_mm: Sequence[float] = (0.5, 1.0),
        n: float = 1.5,
        noise: Noise | None = None,
        seed: int = 0,
        effects: Effects | None = None,
    ) -> Problem:
        """A problem from plain numbers, wavelengths from 500 nm on, 10 nm apart or less.

        Args:
            material: albedo, sigma_t [1/mm] and g by wavelength, shape (W, 3).
            bench: None takes the default bench.
            thickness_mm: thickness [mm] of every sample, shape (S,).
            n: refractive index of the samples.
            noise: None takes 1 %.
            seed: of the noise.
            effects: such as {"thickness[0.5 mm]": {"relative": 0.02}}; None: as described.
        """
        values = np.asarray(material, dtype=np.float64)
        samples = tuple(
            Sample(name=f"sample {number}", thickness_mm=thickness, n=n)
            for number, thickness in enumerate(thickness_mm, 1)
        )
        step = min(10.0, 200.0 / len(values))
        wavelength = 500.0 + step * np.arange(len(values), dtype=np.float64)
        return cls(
            bench or Bench(), samples, wavelength, values, noise or Noise(), seed, effects or {}
        )

    def measured(self, world: World) -> Measured:
        """The visit: exact captures of a world, and noise on them.

        Effects change the world; the measurement and its corrections follow the description.

        Raises:
            InputError: effects that cannot be, or that the world's engine does not show.
        """
        model = BenchModel.of(self.bench, self.samples, self.wavelength_nm)
        true = world_with(self.bench, self.samples, self.effects) if self.effects else None
        if true is None or not true.applied:
            exact = np.asarray(world(model, self.material), dtype=np.float64)
        else:
            exact = captures_with(world, true, self.wavelength_nm, self.material)
        one = np.maximum(self.noise.relative * np.abs(exact), self.noise.floor)
        sigma = one / np.sqrt(self.noise.averages)
        random = np.random.Generator(np.random.Philox(key=[self.seed, 0x6B6974]))
        deviate = random.standard_normal(exact.shape)
        size, count = 3 * len(self.samples), self.wavelength_nm.size
        covariance = np.zeros((count, size, size))
        diagonal = np.arange(size)
        covariance[:, diagonal, diagonal] = sigma.reshape(size, count).T ** 2
        intensities = RelativeIntensities(
            sample_names=model.sample_names,
            thickness_mm=np.array([sample.thickness_mm for sample in self.samples]),
            wavelength_nm=model.wavelength_nm,
            value=exact + self.noise.understated * sigma * deviate,
            covariance=covariance,
            valid=np.ones(exact.shape, dtype=bool),
            reasons=(),
            repeats=self.noise.averages,
        )
        return Measured(model, intensities, self.material)

    def __repr__(self) -> str:
        lines = [
            f"{name}={np.array2string(values, precision=4, separator=', ', legacy=False)}"
            for name, values in zip(("albedo", "sigma_t_per_mm", "g"), self.material.T, strict=True)
        ]
        thickness = [sample.thickness_mm for sample in self.samples]
        lines += [f"thickness_mm={thickness}", f"n={self.samples[0].n}", f"{self.noise}"]
        if self.effects:
            lines.append(f"effects={dict(self.effects)}")
        if self.bench != Bench():
            lines.append(f"{self.bench!r}")
        return f"Problem({', '.join([*lines, f'seed={self.seed}'])})"
