"""The random neighbourhood of the captures in the appearance map (Iser et al. 2022, 4.3)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from estimators.draws import (
    FEWEST,
    MEDIAN,
    Cloud,
    bent_back,
    disagreement,
    gaussian_draws,
    quantiles,
    straightened,
    stream,
    summarise,
    uniform_draws,
    weighted,
)
from estimators.lut_border import Likelihood, inside_map, widened
from estimators.lut_plain import Plain, Table
from estimators.lut_settings import LutSettings
from estimators.result import QUANTILE_LEVELS, Status
from estimators.search import look_up
from twin.spectra import FloatArray

BLOCK = 128
"""Wavelengths that are drawn at a time, which bounds the memory."""
FAR = 16.27
"""Squared distance beyond which chance (1 in 1000, three captures) does not explain it."""
EDGE_STEPS = (0, 0, 16)
"""Most projection steps of one draw where the map is an edge."""
LOST_STEPS = (0, 0, 32)
"""The same of one draw without the beam's light."""
HELD = 1e-6
"""Unit of g where it is given."""
CUT_OFF = 0.5
"""Share of a sample's draws outside the map from which its border decides the estimate: the
captures themselves then lie beyond it."""
DRAW_STEPS = (16, 32, 6)
"""Most search steps of one draw; draws outside the map need no exact distance."""


class Neighbourhoods:
    """Draws around measured captures, looked up and summarised in blocks of wavelengths."""

    def __init__(
        self, tables: list[Table], settings: LutSettings, cut: Plain, covariance: FloatArray
    ) -> None:
        self.tables = tables
        self.settings = settings
        self.cut = cut
        self.covariance = covariance

    def summary(self) -> tuple[list[Cloud], Cloud, NDArray[np.int8], NDArray[np.bool_]]:
        """Clouds of every sample and of all together; status (S, W); who disagrees (W,)."""
        count = len(self.covariance)
        edges = [(first, min(first + BLOCK, count)) for first in range(0, count, BLOCK)]
        # Blocks side by side: while one is looked up, another is sorted and summarised.
        with ThreadPoolExecutor(self.settings.cores) as pool:
            parts = list(pool.map(lambda edge: self._block(*edge), edges))
        clouds = [_joined([part[0][s] for part in parts]) for s in range(len(self.tables))]
        return (
            clouds,
            _joined([part[1] for part in parts]),
            np.concatenate([part[2] for part in parts], axis=1),
            np.concatenate([part[3] for part in parts]),
        )

    def _block(
        self, first: int, last: int
    ) -> tuple[list[Cloud], Cloud, NDArray[np.int8], NDArray[np.bool_]]:
        options, cut = self.settings, self.cut
        here = slice(first, last)
        status = cut.status[:, here].copy()
        samples, count = status.shape
        estimates = np.zeros((samples, count, options.draws, 3))
        kept = np.zeros((samples, count, options.draws), dtype=bool)
        drawn = self._draw(first, last)
        cut_off = np.zeros(count, dtype=bool)
        for s, table in enumerate(self.tables):
            lost = np.flatnonzero(status[s] == Status.COLLIMATED_LOST)
            self._without_beam(s, drawn[s], lost, first, estimates, kept)
            seek = np.flatnonzero(status[s] < Status.CONTRADICTORY)
            seek = seek[status[s, seek] != Status.COLLIMATED_LOST]
            triple = drawn[s][seek]
            possible = np.isfinite(triple).all(axis=2)
            row, draw = np.nonzero(possible)
            start = cut.place[s, here][seek][row]
            found = look_up(
                table.grid,
                triple[row, draw],
                seek[row].astype(np.int32),
                table.power[here],
                start,
                cut.scale[s, here],
                steps=DRAW_STEPS,
                threads=1,
            )
            tolerance = table.grid.errors(cut.place[s, here][seek], *table.rho) + 1e-9
            near = (np.abs(found.rest) <= tolerance[row]).all(axis=1)
            kept[s, seek[row], draw] = found.inside | near
            estimates[s, seek[row], draw] = table.grid.parameters(found.place)
            share = kept[s].mean(axis=1)
            # Also a point beside the map has an estimate when its noise reaches into it.
            reaching = share >= max(options.minimum_inside, FEWEST / options.draws)
            status[s, (status[s] == Status.OUTSIDE_MAP) & reaching] = Status.AT_BOUND
            # Where the map is an edge (nothing scatters, no light comes back) hardly a draw
            # meets it, however near it is: there the draws are projected to the map.
            edge = ~reaching & (status[s] < Status.CONTRADICTORY) & (cut.misfit[s, here] < FAR)
            edge &= status[s] != Status.COLLIMATED_LOST
            if edge.any():
                self._project(s, drawn[s], np.flatnonzero(edge), first, estimates, kept)
                status[s, edge] = Status.AT_BOUND
                reaching |= edge
            seen = (status[s] < Status.CONTRADICTORY) & (status[s] != Status.COLLIMATED_LOST)
            cut_off |= seen & reaching & (share < 1.0 - CUT_OFF)
            status[s, (status[s] == Status.OK) & ~reaching] = Status.OUTSIDE_MAP
            kept[s, status[s] == Status.OUTSIDE_MAP] = False
        # Samples whose collimated light is lost help only where no other sample has any.
        clear = (status < Status.COLLIMATED_LOST).any(axis=0)
        for s in range(samples):
            kept[s, clear & (status[s] == Status.COLLIMATED_LOST)] = False
        clouds = [summarise(estimates[s], kept[s]) for s in range(samples)]
        freedom = 2 if options.fixed_g is not None else 3
        if options.combine == "pool":
            whole = _pooled(estimates, kept)
            return clouds, whole, status, disagreement(clouds, whole.median, freedom)[1]
        if samples == 1:
            whole, torn = clouds[0], np.zeros(count, dtype=bool)
        else:
            whole, torn = self._together(estimates, kept, clouds, freedom)
        if options.neighbourhood == "covariance" and cut_off.any():
            whole = self._inside(np.flatnonzero(cut_off), first, status, whole, torn)
        return clouds, whole, status, torn

    def _together(
        self,
        estimates: FloatArray,
        kept: NDArray[np.bool_],
        clouds: list[Cloud],
        freedom: int,
    ) -> tuple[Cloud, NDArray[np.bool_]]:
        """Draws of all samples combined, and where the samples disagree."""
        samples = len(clouds)
        straight = np.where(kept[..., None], straightened(estimates), 0.0)
        lines = [summarise(straight[s], kept[s]) for s in range(samples)]
        joint, together = weighted(straight, kept, lines)
        middle = quantiles(joint, together)[MEDIAN]
        factor, torn = disagreement(lines, middle, freedom)
        # Samples that contradict each other widen the cloud (Birge 1932).
        wide = np.sqrt(factor)[:, None, None]
        joint = np.where(together[..., None], middle[:, None] + wide * (joint - middle[:, None]), 0)
        low, high = (np.array(side) for side in zip(*self._ranges(), strict=True))
        whole = summarise(np.clip(bent_back(joint), low, high), together)
        missing = np.asarray(~np.isfinite(whole.median).all(axis=1) & kept.any(axis=(0, 2)))
        if missing.any():
            # Too few draws are inside the map for all samples at once: pool them instead.
            whole = _chosen(~missing, whole, _pooled(estimates, kept))
        return whole, torn

    def _inside(
        self,
        seek: NDArray[np.int64],
        first: int,
        status: NDArray[np.int8],
        whole: Cloud,
        torn: NDArray[np.bool_],
    ) -> Cloud:
        """`whole` with the wavelengths `seek` drawn inside the map instead; `torn` in place."""
        options, cut = self.settings, self.cut
        total, clear = self._total(first, first + status.shape[1]), status < Status.CONTRADICTORY
        clear &= (status != Status.COLLIMATED_LOST) & (status != Status.OUTSIDE_MAP)
        draws = np.zeros((len(seek), options.draws, 3))
        clipped = np.full((QUANTILE_LEVELS.size, len(seek), 3), np.nan)
        for row, w in enumerate(seek):
            mine = np.flatnonzero(clear[:, w])
            data = cut.triple[mine, first + w].copy()
            if options.fixed_g is None:
                data[:, 2] = np.exp(data[:, 2])
            index = (3 * mine[:, None] + np.arange(3)).ravel()
            tables = [self.tables[s] for s in mine]
            likelihood = Likelihood.of(
                tables,
                [table.power[first + w] for table in tables],
                data.ravel(),
                total[w][np.ix_(index, index)],
                options.fixed_g,
            )
            starts = [
                table.grid.parameters(cut.place[s, first + w])
                for s, table in zip(mine, tables, strict=True)
            ]
            found = inside_map(
                likelihood,
                np.array(starts),
                options.draws,
                stream(options.seed, first + int(w), 3),
            )
            draws[row], clipped[:, row], torn[w] = found
        own = summarise(draws, np.ones(draws.shape[:2], dtype=bool))
        wide = own._replace(quantile=widened(own.quantile, clipped))
        return _replaced(whole, seek, wide)

    def _project(
        self,
        s: int,
        drawn: FloatArray,
        seek: NDArray[np.int64],
        first: int,
        estimates: FloatArray,
        kept: NDArray[np.bool_],
    ) -> None:
        """Put the material of the map nearest to every draw into `estimates` and `kept`.

        The search starts at g strewn over the whole map: where g changes nothing it stays
        there, so that the spread of the answers tells what the captures leave open.
        """
        options, cut, table = self.settings, self.cut, self.tables[s]
        here = slice(first, first + drawn.shape[0])
        possible = np.isfinite(drawn[seek]).all(axis=2)
        row, draw = np.nonzero(possible)
        start = cut.place[s, here][seek][row]
        if options.fixed_g is None:
            anywhere = self._strewn(seek, first, 1)[..., 0] * (table.grid.shape[2] - 1)
            start[:, 2] = anywhere[row, draw]
        found = look_up(
            table.grid,
            drawn[seek[row], draw],
            seek[row].astype(np.int32),
            table.power[here],
            start,
            np.maximum(cut.scale[s, here], 1e-12),
            steps=EDGE_STEPS,
            threads=1,
        )
        kept[s, seek] = possible
        estimates[s, seek[row], draw] = table.grid.parameters(found.place)

    def _without_beam(
        self,
        s: int,
        drawn: FloatArray,
        seek: NDArray[np.int64],
        first: int,
        estimates: FloatArray,
        kept: NDArray[np.bool_],
    ) -> None:
        """Put materials that fit black and white alone into `estimates` and `kept`.

        Without the beam's light any g may be: it is strewn over the map, and black and white
        are looked up in its plane. Where they leave sigma_t open it stays where the search
        starts, strewn from the least that loses the beam. What lets more of the beam through
        than the noise could hide does not count.
        """
        if not seek.size:
            return
        options, cut, table = self.settings, self.cut, self.tables[s]
        here, planes = slice(first, first + drawn.shape[0]), table.grid.planes
        possible = np.isfinite(drawn[seek][..., :2]).all(axis=2)
        row, draw = np.nonzero(possible)
        w = seek[row]
        anywhere = self._strewn(seek, first, 2)[row, draw]
        last = np.array(table.grid.shape) - 1
        start = cut.place[s, here][w]
        start[:, 1] += anywhere[:, 1] * (last[1] - start[:, 1])
        start[:, 2] = anywhere[:, 0] * last[2]
        target = drawn[w, draw].copy()
        target[:, 2] = np.interp(start[:, 2], np.arange(last[2] + 1.0), table.grid.axes[2])
        scale = np.maximum(cut.scale[s, here], 1e-12)
        if options.neighbourhood == "epsilon":
            scale = np.maximum(scale, options.epsilon)
        # g is held: its unit is far below what black and white could gain by moving it.
        scale[:, 2] = HELD
        found = look_up(
            planes,
            target,
            w.astype(np.int32),
            table.power[here],
            start,
            scale,
            steps=LOST_STEPS,
            threads=1,
        )
        misfit = np.sum((found.rest / scale[w])[:, :2] ** 2, axis=1)
        through = table.grid.captures(found.place, table.power[here][w])[:, 2]
        fits = (misfit < FAR) & (through <= cut.triple[s, here][w, 2])
        kept[s, w, draw] = fits
        estimates[s, w, draw] = table.grid.parameters(found.place)

    def _strewn(self, seek: NDArray[np.int64], first: int, columns: int) -> FloatArray:
        """Uniform numbers from 0 to 1 for what captures leave open, (W', draws, columns).

        The same for every sample: what no sample tells, many samples do not tell either.
        """
        options = self.settings
        return np.stack(
            [
                stream(options.seed, first + int(w), 1).uniform(size=(options.draws, columns))
                for w in seek
            ]
        )

    def _ranges(self) -> list[tuple[float, float]]:
        """Least and greatest parameter of all maps."""
        axes = zip(*(table.grid.axes for table in self.tables), strict=True)
        return [(min(a[0] for a in axis), max(a[-1] for a in axis)) for axis in axes]

    def _draw(self, first: int, last: int) -> FloatArray:
        """Triples around the measured ones, shape (S, W', draws, 3)."""
        options, cut = self.settings, self.cut
        here = slice(first, last)
        samples, count = cut.status[:, here].shape
        centre = cut.triple[:, here, None, :]
        if options.neighbourhood == "epsilon":
            uniform = uniform_draws(3 * samples, count, options.draws, options.seed, first)
            around = uniform.reshape(count, options.draws, samples, 3).transpose(2, 0, 1, 3)
            drawn = centre + options.epsilon * around
        else:
            noise = gaussian_draws(self._total(first, last), options.draws, options.seed, first)
            noise = noise.reshape(count, options.draws, samples, 3).transpose(2, 0, 1, 3)
            drawn = centre + noise
            if options.fixed_g is None:
                with np.errstate(invalid="ignore", divide="ignore"):
                    drawn[..., 2] = np.log(np.exp(centre[..., 2]) + noise[..., 2])
        if options.fixed_g is not None:
            drawn[..., 2] = options.fixed_g
            return drawn
        return drawn

    def _total(self, first: int, last: int) -> FloatArray:
        """Covariance of the captures with the maps' own errors, (W', 3S, 3S)."""
        cut, here = self.cut, slice(first, last)
        samples, count = cut.status[:, here].shape
        errors = np.zeros((count, samples, 3))
        for s, table in enumerate(self.tables):
            place = cut.place[s, here]
            seek = np.isfinite(place).all(axis=1)
            errors[seek, s] = table.grid.errors(place[seek], *table.rho)
        if self.settings.fixed_g is None:
            errors[:, :, 2] *= np.exp(np.nan_to_num(cut.triple[:, here, 2])).T
        total = self.covariance[here].copy()
        diagonal = np.arange(3 * samples)
        total[:, diagonal, diagonal] += errors.reshape(count, -1) ** 2
        return total


def _replaced(whole: Cloud, where: NDArray[np.int64], other: Cloud) -> Cloud:
    """`whole` with `other` at the wavelengths `where`."""
    quantile, covariance = whole.quantile.copy(), whole.covariance.copy()
    members = whole.members.copy()
    quantile[:, where], covariance[where] = other.quantile, other.covariance
    members[where] = other.members
    return Cloud(quantile, covariance, members)


def _pooled(estimates: FloatArray, kept: NDArray[np.bool_]) -> Cloud:
    """All draws of all samples in one cloud (Iser et al. 2022, section 4.3)."""
    count = estimates.shape[1]
    return summarise(
        estimates.transpose(1, 0, 2, 3).reshape(count, -1, 3),
        kept.transpose(1, 0, 2).reshape(count, -1),
    )


def _joined(parts: list[Cloud]) -> Cloud:
    return Cloud(
        np.concatenate([part.quantile for part in parts], axis=1),
        np.concatenate([part.covariance for part in parts]),
        np.concatenate([part.members for part in parts]),
    )


def _chosen(first: NDArray[np.bool_], one: Cloud, other: Cloud) -> Cloud:
    return Cloud(
        np.where(first[None, :, None], one.quantile, other.quantile),
        np.where(first[:, None, None], one.covariance, other.covariance),
        np.where(first, one.members, other.members),
    )
