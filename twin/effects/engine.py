"""Worlds near one bench, in milliseconds: what a diagnosis evaluates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.effects.effect import Candidate, EffectParameter, Values
from twin.effects.expected import expected_intensities
from twin.effects.fast import FastLight
from twin.effects.lattice import Lattice, corners, material_at
from twin.effects.readout import Readout
from twin.effects.registry import LeftOut
from twin.effects.world import World
from twin.errors import InputError
from twin.materials import reflectance
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.appearance import FiniteFactors

DIM = 1e-3
"""Added to relative intensities before relative changes are formed: nothing is divided by 0."""
MOST_KEPT = 512
"""Arrays kept in memory of each kind."""
EVEN_AT = (0.5, 1.0, 2.0)
"""Prior scales at which the response to an even parameter is taken."""
SMALL_STEP = 0.1
"""Share of the prior scale over which derivatives are taken."""


@dataclass(frozen=True, eq=False)
class EffectEngine:
    """Expected relative intensities of worlds near one bench, and how effects change them.

    The light is that of the plane-parallel engine with the factors of the nominal finite bench;
    what an effect does that this engine cannot see comes from responses of the Monte Carlo with
    common random numbers (`twin.effects.lattice`), quadratic in each parameter and added up.

    Attributes:
        world: without further effects: `World.nominal(bench, samples)`.
        wavelength_nm: [nm], shape (W,).
        factors: finite-bench factors of the samples, or ().
        readout: brightness and exposures; None plans them.
        least_paths, seed: of the Monte Carlo's responses.
        more_paths: of the effects whose response needs more, by name.
        folder: of the cache; None is the user's.
        threads: None takes all processors.
        say: told of what a person should know.
    """

    world: World
    wavelength_nm: FloatArray
    factors: tuple[FiniteFactors, ...] = ()
    readout: Readout | None = None
    least_paths: int = 8192
    seed: int = 0
    folder: Path | None = None
    threads: int | None = None
    say: Callable[[str], None] = print
    more_paths: dict[str, int] = field(default_factory=dict)
    _kept: dict[Any, tuple[FloatArray, FloatArray]] = field(default_factory=dict, repr=False)
    _lattices: dict[int, Lattice] = field(default_factory=dict, repr=False)
    _plain_light: dict[bytes, FloatArray] = field(default_factory=dict, repr=False)

    @cached_property
    def fast(self) -> FastLight:
        """The plane-parallel engine with the nominal factors."""
        return FastLight(np.asarray(self.wavelength_nm, dtype=np.float64), self.factors)

    def paths(self, candidate: Candidate) -> int:
        """Light paths of the Monte Carlo's responses to an effect."""
        return self.more_paths.get(candidate.name, self.least_paths)

    def lattice_of(self, candidate: Candidate) -> Lattice:
        """The Monte Carlo's responses to an effect."""
        paths = self.paths(candidate)
        if paths not in self._lattices:
            self._lattices[paths] = self._new_lattice(paths)
        return self._lattices[paths]

    def _new_lattice(self, paths: int) -> Lattice:
        middle = float(self.wavelength_nm[len(self.wavelength_nm) // 2])
        return Lattice(self.plain, middle, paths, self.seed, self.folder, self.say, self.threads)

    @cached_property
    def plain(self) -> World:
        """The described world without any effect: where responses start from."""
        bench = self.world.described_bench.model_copy(update={"effects": ()})
        return World.nominal(bench, self.world.described_samples)

    def light(self, world: World, material: FloatArray) -> FloatArray:
        """Noiseless light of a world, shape (W, S, 3).

        Args:
            world: `self.world`, or what candidates made of it.
            material: albedo, sigma_t [1/mm] and g, shape (W, 3).

        Raises:
            InputError: a world that cannot be.
        """
        light = self._plane(world, material)
        for applied in world.applied:
            own = applied.candidate
            if own.engine == "monte_carlo":
                light = light + self._beyond(own, applied.values, material)[0]
        return light

    def intensities(self, world: World, material: FloatArray) -> FloatArray:
        """Expected relative intensities as the described corrections report them, (W, S, 3)."""
        return expected_intensities(
            world, self.light(world, material), self.wavelength_nm, self.readout
        )

    def response(
        self, candidate: Candidate, material: FloatArray, values: Values,
        world: World | None = None,
    ) -> FloatArray:  # fmt: skip
        """Change of the expected intensities by an effect, nonlinear, shape (W, S, 3).

        Args:
            candidate: the effect.
            material: albedo, sigma_t [1/mm] and g, shape (W, 3).
            values: of its parameters.
            world: that it is added to; None takes `self.world`.

        Raises:
            InputError: values or a world that cannot be.
        """
        before = self.world if world is None else world
        after = candidate.apply(before, values)
        if after is before:
            return np.zeros((len(material), len(before.samples), 3))
        return self.intensities(after, material) - self.intensities(before, material)

    def signature(
        self, candidate: Candidate, material: FloatArray, world: World | None = None
    ) -> FloatArray:
        """Change of the expected intensities per unit of each parameter, (params, W, S, 3).

        Derivatives at the nominal value: central where the sign is free, one-sided where it is
        not. Of a parameter that is `even` the slope of the secant to one prior scale.

        Raises:
            InputError: an effect that these materials or this bench cannot have.
        """
        rows = []
        before = self.intensities(self.world if world is None else world, material)
        for parameter in candidate.parameters:
            rows.append(self._slope(candidate, parameter, material, world, before))
        return np.stack(rows)

    def signatures(
        self, candidates: Sequence[Candidate], material: FloatArray, world: World | None = None
    ) -> tuple[dict[str, FloatArray], tuple[LeftOut, ...]]:
        """`signature` of many candidates by name, (params, W, S, 3) each, and those left out.

        One that raises, or gives something that is no number or of another shape, is named with
        the reason and left out; the rest goes on.
        """
        found: dict[str, FloatArray] = {}
        left_out = []
        for each in candidates:
            shape = (len(each.parameters), len(material), len(self.world.samples), 3)
            try:
                own = self.signature(each, material, world)
            except Exception as error:  # noqa: BLE001 - a user's entry may raise anything
                left_out.append(LeftOut(each.name, f"{type(error).__name__}: {error}"))
                continue
            if own.shape != shape:
                left_out.append(LeftOut(each.name, f"an answer of shape {own.shape}, not {shape}"))
            elif not np.isfinite(own).all():
                left_out.append(LeftOut(each.name, "an answer that is not a number"))
            else:
                found[each.name] = own
        return found, tuple(left_out)

    def signature_error(self, candidate: Candidate, material: FloatArray) -> FloatArray:
        """Standard error of `signature` by the Monte Carlo's noise, (params, W, S, 3); mostly 0."""
        shape = (len(material), len(self.world.samples), 3)
        if candidate.engine != "monte_carlo":
            return np.zeros((len(candidate.parameters), *shape))
        rows = []
        for parameter in candidate.parameters:
            value = parameter.nominal + _away(parameter)
            error = self._measured(candidate, parameter, value, material)[1]
            rows.append(error / abs(_away(parameter)))
        return np.stack(rows)

    def _slope(
        self, candidate: Candidate, parameter: EffectParameter, material: FloatArray,
        world: World | None, before: FloatArray,
    ) -> FloatArray:  # fmt: skip
        step = _away(parameter) * (1.0 if parameter.even else SMALL_STEP)
        base = self.world if world is None else world

        def at(value: float) -> FloatArray:
            return self.intensities(candidate.apply(base, {parameter.name: value}), material)

        ahead = (at(parameter.nominal + step) - before) / step
        if parameter.even or parameter.sign != "any":
            return ahead
        try:
            back = (before - at(parameter.nominal - step)) / step
        except InputError:
            return ahead
        return 0.5 * (ahead + back)

    def _plane(self, world: World, material: FloatArray) -> FloatArray:
        return self.fast.captures(world, material)

    def _beyond(
        self, candidate: Candidate, values: Sequence[float], material: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What an effect adds that the plane-parallel engine does not see, and its error.

        A parabola through two prior scales for each parameter; for an even one, whose response
        need not follow the square for long, a polynomial through `EVEN_AT` without a slope at
        nominal. Parameters add up.
        """
        total = np.zeros((len(material), len(self.world.samples), 3))
        error = np.zeros_like(total)
        for parameter, value in zip(candidate.parameters, values, strict=True):
            away = value - parameter.nominal
            if away == 0.0:
                continue
            near = _away(parameter)
            one, one_error = self._measured(
                candidate, parameter, parameter.nominal + near, material
            )
            x = away / near
            if parameter.even:
                for at, share in zip(EVEN_AT, _even_shares(abs(x)), strict=True):
                    if share:
                        there = parameter.nominal + at * near
                        own = self._measured(candidate, parameter, there, material)[0]
                        total = total + share * own
            else:
                far = -1.0 if parameter.sign == "any" else 2.0
                other = self._measured(
                    candidate, parameter, parameter.nominal + far * near, material
                )[0]
                # parabola through 0, one at 1 and other at far
                bend = (other - far * one) / (far**2 - far)
                total = total + x * (one - bend) + x**2 * bend
            error = error + abs(x) * one_error
        return total, error

    def _measured(
        self, candidate: Candidate, parameter: EffectParameter, value: float, material: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Light beyond the plane-parallel engine at one value, and its error, (W, S, 3) each."""
        material = np.asarray(material, dtype=np.float64)
        paths = self.paths(candidate)
        key = (candidate.name, parameter.name, value, paths, material.tobytes())
        if key not in self._kept:
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[key] = self._measure(candidate, parameter, value, material)
        return self._kept[key]

    def _measure(
        self, candidate: Candidate, parameter: EffectParameter, value: float, material: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        plain = self.plain
        changed = candidate.apply(plain, {parameter.name: value})
        free = not changed.sublayers
        around = corners(material, free)
        needed = {
            node for nodes, weight in around for node, w in zip(nodes, weight, strict=True) if w
        }
        lattice = self.lattice_of(candidate)
        tables = [lattice.nodes(changed, number, needed) for number in range(len(plain.samples))]
        background = plain.bench.background
        rho = [
            reflectance(each.reflectance, self.wavelength_nm)
            for each in (background.black, background.white)
        ]
        here = self._plane(plain, material)
        plane_sees = not np.array_equal(here, self._plane(changed, material))
        total, error = np.zeros_like(here), np.zeros_like(here)
        for nodes, weight in around:
            there = np.array([material_at(node) for node in nodes])[:, [2, 0, 1]]
            if free:
                there[:, 0] = material[:, 0]
            seen = self._seen(there)
            change = seen - self._plane(changed, there) if plane_sees else np.zeros_like(seen)
            noise = np.zeros_like(change)
            for number, table in enumerate(tables):
                for node in set(nodes) & needed:
                    rows = np.array([each == node for each in nodes]) & (weight > 0.0)
                    at = there[rows, 0]
                    change[rows, number] += table[node].at(at, rho[0][rows], rho[1][rows])
                    noise[rows, number] = table[node].error_at(at)
            scale = weight[:, None, None] / (seen + DIM)
            total += scale * change
            # neighbouring nodes share their random numbers: errors add up
            error += scale * noise
        return total * (here + DIM), error * (here + DIM)

    def _seen(self, material: FloatArray) -> FloatArray:
        """The plain world by the plane-parallel engine: the same for every effect."""
        key = material.tobytes()
        if key not in self._plain_light:
            if len(self._plain_light) >= MOST_KEPT:
                self._plain_light.clear()
            self._plain_light[key] = self._plane(self.plain, material)
        return self._plain_light[key]


def _even_shares(x: float) -> FloatArray:
    """Weights of the responses at `EVEN_AT` at x prior scales: a x^2 + b x^3 + c x^4 through them.

    Beyond the last it goes on straight: a power of four would run away.
    """
    at = np.array(EVEN_AT)
    power = np.arange(2, 2 + at.size)
    inside = min(x, at[-1])
    row = inside**power + (x - inside) * power * inside ** (power - 1)
    shares = np.linalg.solve((at[:, None] ** power).T, row)
    return np.where(np.abs(shares) > 1e-9, shares, 0.0)


def _away(parameter: EffectParameter) -> float:
    """One prior scale, in the direction that the sign allows."""
    return -parameter.prior_scale if parameter.sign == "negative" else parameter.prior_scale


__all__ = ["DIM", "EffectEngine"]
