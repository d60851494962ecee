"""An appearance map prepared for look-ups: nodes, starting points, and the way back.

A place is a point in grid coordinates (node number plus fraction along albedo, sigma_t, g).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from twin.spectra import FloatArray

FLOOR = 1e-30
"""Least collimated intensity: the logarithm of a node that transmits nothing."""


class Map(Protocol):
    """What the look-up needs of `twin.appearance.AppearanceMap`."""

    @property
    def albedo(self) -> FloatArray:
        """Nodes, increasing, shape (A,)."""
        ...

    @property
    def sigma_t_per_mm(self) -> FloatArray:
        """Nodes [1/mm], increasing, shape (S,)."""
        ...

    @property
    def g(self) -> FloatArray:
        """Nodes, increasing, shape (G,)."""
        ...

    @property
    def thickness_mm(self) -> float:
        """Thickness of the sample [mm]."""
        ...

    @property
    def exponent(self) -> FloatArray:
        """Exponents of the background's reflectance, shape (B,)."""
        ...

    @property
    def black_series(self) -> FloatArray:
        """Coefficients over the black background, shape (A, S, G, B)."""
        ...

    @property
    def white_series(self) -> FloatArray:
        """Coefficients over the white background, shape (A, S, G, B)."""
        ...

    @property
    def collimated(self) -> FloatArray:
        """Collimated intensity, shape (A, S, G)."""
        ...

    @property
    def black_se(self) -> FloatArray:
        """Standard error of the black capture, shape (A, S, G)."""
        ...

    @property
    def white_se(self) -> FloatArray:
        """Standard error of the white capture, shape (A, S, G)."""
        ...

    @property
    def collimated_se(self) -> FloatArray:
        """Standard error of the collimated capture, shape (A, S, G)."""
        ...


@dataclass(frozen=True, eq=False)
class MapNodes:
    """Nodes of one appearance map in the layout of the kernels."""

    axes: tuple[FloatArray, FloatArray, FloatArray]
    """Albedo, sigma_t [1/mm] and g of the nodes."""
    exponent: FloatArray
    series: FloatArray
    """Coefficients of every node, black then white, shape (N, 2B)."""
    third: FloatArray
    """ln I_collimated of every node, or its g in the two-dimensional map, shape (N,)."""
    se: FloatArray
    """Standard errors of the triple at every node, shape (N, 3)."""
    thickness_mm: float
    fixed_g: bool
    digest: str
    """SHA-256 of everything above."""
    _trees: dict[tuple[float, float], tuple[Any, FloatArray]] = field(default_factory=dict)
    _bends: dict[tuple[float, float], FloatArray] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of nodes along albedo, sigma_t and g."""
        return (len(self.axes[0]), len(self.axes[1]), len(self.axes[2]))

    @classmethod
    def of(cls, source: Map, *, fixed_g: float | None = None) -> MapNodes:
        """Prepare a map; with `fixed_g` the two-dimensional map (Iser et al. 2022, 3.1).

        Raises:
            ValueError: an axis with fewer than two nodes or not increasing, non-finite nodes,
                or a fixed g outside the map.
        """
        axes = tuple(
            np.asarray(axis, dtype=np.float64)
            for axis in (source.albedo, source.sigma_t_per_mm, source.g)
        )
        for name, axis in zip(("albedo", "sigma_t_per_mm", "g"), axes, strict=True):
            if axis.size < 2 or np.any(np.diff(axis) <= 0):
                raise ValueError(
                    f"found {axis.size} nodes along {name}; expected two or more, increasing"
                )
        shape = tuple(axis.size for axis in axes)
        black = np.asarray(source.black_series, dtype=np.float64)
        white = np.asarray(source.white_series, dtype=np.float64)
        collimated = np.asarray(source.collimated, dtype=np.float64)
        floor = np.maximum(collimated, FLOOR)
        third = np.log(floor)
        third_se = np.where(collimated > FLOOR, source.collimated_se / floor, 0.0)
        if fixed_g is not None:
            low, high = axes[2][0], axes[2][-1]
            if not low <= fixed_g <= high:
                raise ValueError(
                    f"found g {fixed_g:g}; expected it inside the map's {low:g} to {high:g}"
                )
            # The third capture of this map is g itself, which makes the plane g = fixed_g of
            # the three-dimensional map the two-dimensional one, without another search.
            third = np.broadcast_to(axes[2], shape).copy()
            third_se = np.zeros(shape)
        series = np.ascontiguousarray(np.concatenate([black, white], axis=-1))
        series = series.reshape(-1, series.shape[-1])
        se = np.stack([source.black_se, source.white_se, third_se], axis=-1).reshape(-1, 3)
        if not (np.isfinite(series).all() and np.isfinite(third).all()):
            raise ValueError("found NaN or infinite nodes in the appearance map; compute it again")
        exponent = np.asarray(source.exponent, dtype=np.float64)
        digest = hashlib.sha256()
        for part in (*axes, exponent, series, third, se, np.array([source.thickness_mm])):
            digest.update(np.ascontiguousarray(part).tobytes())
        return cls(
            (axes[0], axes[1], axes[2]),
            exponent,
            series,
            third.reshape(-1).copy(),
            np.ascontiguousarray(se),
            float(source.thickness_mm),
            fixed_g is not None,
            digest.hexdigest(),
        )

    @cached_property
    def planes(self) -> MapNodes:
        """The same map with g itself for the third capture: black and white at a known g."""
        third = np.broadcast_to(self.axes[2], self.shape).reshape(-1).copy()
        se = self.se.copy()
        se[:, 2] = 0.0
        return replace(self, third=third, se=se, fixed_g=True, _trees={}, _bends={})

    def power(self, rho_black: FloatArray, rho_white: FloatArray) -> FloatArray:
        """Background reflectances (W,) to the map's exponents, black then white, (W, 2B)."""
        return np.ascontiguousarray(
            np.concatenate(
                [np.power(rho[:, None], self.exponent) for rho in (rho_black, rho_white)], axis=1
            )
        )

    def parameters(self, place: FloatArray) -> FloatArray:
        """Albedo, sigma_t [1/mm] and g at places (..., 3), shape (..., 3).

        Between nodes -ln(1 - albedo), sigma_t and g run linearly, in which the captures bend
        least; in the last cell below albedo 1 the albedo itself does.
        """
        parameters = np.empty(place.shape)
        for index, (axis, run, scale) in enumerate(
            zip(self.axes, self._runs, _SCALES, strict=True)
        ):
            parameters[..., index] = _along(axis, run, scale, place[..., index])
        return parameters

    def places(self, parameters: FloatArray) -> FloatArray:
        """Grid coordinates of parameters (..., 3), the inverse of `parameters`; NaN outside."""
        place = np.empty(parameters.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            for index, (axis, run, scale) in enumerate(
                zip(self.axes, self._runs, _SCALES, strict=True)
            ):
                value = parameters[..., index]
                cell = _cell(axis.searchsorted(value, side="right") - 1, axis)
                low, high = run[cell], run[cell + 1]
                fraction = (scale(value) - low) / (high - low)
                if not np.isfinite(run[-1]):
                    straight = (value - axis[cell]) / (axis[cell + 1] - axis[cell])
                    fraction = np.where(np.isfinite(high), fraction, straight)
                within = (value >= axis[0]) & (value <= axis[-1])
                place[..., index] = np.where(within, cell + fraction, np.nan)
        return place

    @cached_property
    def _runs(self) -> tuple[FloatArray, ...]:
        """The nodes of the three axes on the scales of `parameters`; infinite at albedo 1."""
        with np.errstate(divide="ignore"):
            return tuple(scale(axis) for axis, scale in zip(self.axes, _SCALES, strict=True))

    def captures(self, place: FloatArray, power: FloatArray) -> FloatArray:
        """Capture triples at places (W, 3), shape (W, 3); NaN where the place is NaN.

        Backgrounds are from `power`: of one wavelength each, (W, 2B), or of one for all, (1, 2B).
        """
        shape = np.array(self.shape)
        known = np.asarray(np.isfinite(place).all(axis=-1))
        safe = np.where(known[:, None], place, 0.0)
        corner = np.minimum(np.maximum(np.floor(safe).astype(np.int64), 0), shape - 2)
        fraction = safe - corner
        order = np.argsort(-fraction, axis=-1, kind="stable")
        falling = fraction[np.arange(len(place))[:, None], order]
        strides = np.array([shape[1] * shape[2], shape[2], 1])
        along = strides[order]
        node = corner @ strides
        total: FloatArray = self._triple(node, power) * (1.0 - falling[:, :1])
        for step in range(3):
            node = node + along[:, step]
            rest = falling[:, step + 1] if step < 2 else 0.0
            total += self._triple(node, power) * (falling[:, step] - rest)[:, None]
        total[~known] = np.nan
        return total

    def errors(self, place: FloatArray, rho_black: float, rho_white: float) -> FloatArray:
        """Standard errors of the map's triple near places (Q, 3), shape (Q, 3).

        Those of its nodes and that of the interpolation between them, added in squares.
        """
        shape = np.array(self.shape)
        node = np.clip(np.rint(place).astype(np.int64), 0, shape - 1)
        flat = (node[:, 0] * shape[1] + node[:, 1]) * shape[2] + node[:, 2]
        return np.asarray(np.hypot(self.se[flat], self.bending(rho_black, rho_white)[flat]))

    def bending(self, rho_black: float, rho_white: float) -> FloatArray:
        """Size of the interpolation's error of the triple at every node, shape (N, 3).

        Between nodes a distance h apart, linear interpolation of a curve misses at most
        h^2 |F''| / 8, and 0.73 of that in the root mean square; of a twist x y F_xy the Kuhn
        elements miss x y - min(x, y), 0.105 in the root mean square. All add in squares.
        """
        key = (rho_black, rho_white)
        if key not in self._bends:
            power = self.power(np.array([rho_black]), np.array([rho_white]))
            cube = self._triple(np.arange(self.third.size), power).reshape(*self.shape, 3)
            total = np.zeros_like(cube)
            for index, nodes in enumerate(self._runs):
                run = nodes.copy()
                if not np.isfinite(run[-1]):
                    run[-1] = run[-2] + (run[-2] - run[-3] if run.size > 2 else 1.0)
                total += _bend_along(np.moveaxis(cube, index, 0), run, index) ** 2
            for one, other in ((0, 1), (0, 2), (1, 2)):
                twist = np.diff(np.diff(cube, axis=one), axis=other)
                after = [(0, int(axis in (one, other))) for axis in range(4)]
                total += (0.105 * np.pad(twist, after, mode="edge")) ** 2
            self._bends[key] = np.sqrt(total).reshape(-1, 3)
        return self._bends[key]

    def nearest(
        self, triple: FloatArray, rho_black: float, rho_white: float, *, rank: int = 1
    ) -> FloatArray:
        """Place of the node next to each triple (Q, 3) at given backgrounds, shape (Q, 3).

        Next in a space where the captures correlate less: I_black, I_white - I_black and the
        third, each in units of its spread over the map. A rank above 1 gives the second, the
        third node and so on.
        """
        from scipy.spatial import cKDTree

        key = (rho_black, rho_white)
        if key not in self._trees:
            power = self.power(np.array([rho_black]), np.array([rho_white]))
            cloud = _spread_out(self._triple(np.arange(self.third.size), power))
            unit = np.maximum(cloud.std(axis=0), 1e-12)
            self._trees[key] = (cKDTree(cloud / unit), unit)
        tree, unit = self._trees[key]
        _, node = tree.query(_spread_out(triple) / unit, k=[min(rank, self.third.size)])
        return np.stack(np.unravel_index(node[:, 0], self.shape), axis=-1).astype(np.float64)

    def _triple(self, node: NDArray[np.int64], power: FloatArray) -> FloatArray:
        """Captures (N, 3) of nodes (N,) at `power` (N or 1, 2B)."""
        terms = self.exponent.size
        product = self.series[node] * power
        triple = np.empty((node.size, 3))
        triple[:, 0] = product[:, :terms].sum(axis=1)
        triple[:, 1] = product[:, terms:].sum(axis=1)
        triple[:, 2] = self.third[node]
        return triple


def _spread_out(triple: FloatArray) -> FloatArray:
    return np.stack([triple[:, 0], triple[:, 1] - triple[:, 0], triple[:, 2]], axis=-1)


def _minus_log_rest(albedo: FloatArray) -> FloatArray:
    return np.asarray(-np.log1p(-albedo))


def _minus_log_rest_inverse(value: FloatArray) -> FloatArray:
    return np.asarray(-np.expm1(-value))


def _same(value: FloatArray) -> FloatArray:
    return np.array(value)


_SCALES = (_minus_log_rest, _same, _same)
_INVERSES = {_minus_log_rest: _minus_log_rest_inverse, _same: _same}


def _bend_along(cube: FloatArray, run: FloatArray, index: int) -> FloatArray:
    """0.73 h^2 |F''| / 8 along the first axis, put back to axis `index`."""
    bend = np.zeros_like(cube)
    if run.size > 2:
        step = np.diff(run).reshape(-1, *([1] * (cube.ndim - 1)))
        slope = np.diff(cube, axis=0) / step
        second = 2.0 * np.diff(slope, axis=0) / (step[1:] + step[:-1])
        bend[1:-1] = 0.73 / 8.0 * step[1:] * step[:-1] * np.abs(second)
        bend[0], bend[-1] = bend[1], bend[-2]
    return np.moveaxis(bend, 0, index)


def _along(axis: FloatArray, run: FloatArray, scale: Any, place: FloatArray) -> FloatArray:
    """Values of one axis at places (...); `run` are its nodes on their scale."""
    known = np.where(np.isnan(place), 0.0, place)
    cell = _cell(np.floor(known).astype(np.int64), axis)
    fraction = place - cell
    low, high = run[cell], run[cell + 1]
    with np.errstate(invalid="ignore"):
        value = _INVERSES[scale](low + fraction * (high - low))
    if not np.isfinite(run[-1]):
        start = axis[cell]
        straight = start + fraction * (axis[cell + 1] - start)
        value = np.where(np.isfinite(high), value, straight)
    return np.asarray(value)


def _cell(index: NDArray[np.int64], axis: FloatArray) -> NDArray[np.int64]:
    """Numbers of cells, those beyond the ends put into the last; `np.clip` is slow on few."""
    return np.asarray(np.minimum(np.maximum(index, 0), axis.size - 2))
