"""Where the gap shows, and where it enters.

It shows where residuals are larger than noise: blocks of captures x samples x wavelength band x
repeats are scanned, and the largest is judged against the largest of simulated ones (maxT:
Westfall and Young 1993). But the material's fit smears a misfit over every channel it can. The
gap enters where taking the data away heals the rest: freeing a block (a smooth deviation of its
own, all of it) is the same as predicting it from all others.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.stats import chi2

from diagnosis.adequacy import off, orthonormal
from diagnosis.calibration import generator_of
from diagnosis.problem import Problem
from diagnosis.refit import Fit
from diagnosis.unknown import polynomials, smooth_columns
from twin.spectra import FloatArray

DRAWS = 1000
BANDS = (1, 2, 4)
"""Numbers of equal parts that the wavelengths are cut into."""
SMOOTH = 10
"""Polynomials over wavelength that a block's own deviation is made of."""
HEALED = 0.05
"""p of the rest above which it counts as healed."""


@dataclass(frozen=True)
class Block:
    """A part of the data.

    Attributes:
        captures: names; () for all.
        samples: names; () for all.
        band_nm: shortest and longest wavelength [nm]; None for all.
        repeat: its number; None for what all repeats share.
        statistic: energy above what noise has, in its standard deviations.
        p: family-wise adjusted.
    """

    captures: tuple[str, ...]
    samples: tuple[str, ...]
    band_nm: tuple[float, float] | None
    repeat: int | None
    statistic: float
    p: float


@dataclass(frozen=True)
class Entry:
    """What happens to the gap when a block is left out of the fit.

    Attributes:
        captures: left out; () for all.
        samples: left out; () for all.
        repeat: left out; None for all.
        missed: p of the block's data, predicted from all others.
        rest: p of what is left of the gap in the others.
        healed: share of the gap's excess that is gone.
        heals: whether the rest is noise.
    """

    captures: tuple[str, ...]
    samples: tuple[str, ...]
    repeat: int | None
    missed: float
    rest: float
    healed: float
    heals: bool


def shows(problem: Problem, null: Fit, *, seed: int = 0, draws: int = DRAWS) -> tuple[Block, ...]:
    """Blocks in the order of their significance, those within a stronger one left out."""
    sums, keys = _cells(problem)
    sums = sums * null.reduction.valid.ravel()
    noise = null.reduction.simulate(generator_of(seed, 3), draws)
    drawn = (sums @ noise).T  # (draws, cells)
    spread = drawn.std(axis=0)
    spread = np.where(spread > 1e-9, spread, np.inf)
    energy_null = (drawn / spread) ** 2
    energy = (sums @ null.residual / spread) ** 2
    captures = [(), *((c,) for c in dict.fromkeys(c.capture for c in problem.channels))]
    samples = [(), *((s,) for s in dict.fromkeys(c.sample for c in problem.channels))]
    members, labels = [], []
    for own_c, own_s, (band, repeat) in product(
        captures, samples, dict.fromkeys((k[2], k[3]) for k in keys)
    ):
        mask = [
            (not own_c or k[0] in own_c) and (not own_s or k[1] in own_s)
            and k[2] == band and k[3] == repeat
            for k in keys
        ]  # fmt: skip
        members.append(mask)
        labels.append((own_c, own_s, band, repeat))
    pick = np.array(members, dtype=float)
    null_sums, seen = energy_null @ pick.T, pick @ energy
    mean, variance = null_sums.mean(axis=0), null_sums.var(axis=0)
    # A scaled chi-square with the simulated mean and variance (Satterthwaite 1946) has a cube
    # root that is nearly normal (Wilson and Hilferty 1931): blocks of any size compare.
    spread_out = np.maximum(variance, 1e-12) / np.maximum(mean, 1e-12) ** 2 / 9.0

    def rarity(sums: FloatArray) -> FloatArray:
        root = np.cbrt(sums / np.maximum(mean, 1e-12))
        return np.asarray((root - 1.0 + spread_out) / np.sqrt(spread_out))

    loudest = rarity(null_sums).max(axis=1)
    rare = rarity(seen)
    wavelength = problem.wavelength_nm
    chosen: list[Block] = []
    taken = np.zeros(len(labels), dtype=bool)
    for index in np.argsort(-rare, kind="stable"):
        own_c, own_s, band, repeat = labels[index]
        if taken[index]:
            continue
        taken |= _overlap(labels, labels[index])
        parts, part = band
        edge = np.array_split(np.arange(wavelength.size), parts)[part]
        chosen.append(
            Block(
                captures=own_c,
                samples=own_s,
                band_nm=None
                if parts == 1
                else (float(wavelength[edge[0]]), float(wavelength[edge[-1]])),
                repeat=repeat,
                statistic=float((seen[index] - mean[index]) / np.sqrt(variance[index])),
                p=float((1 + np.sum(loudest >= rare[index])) / (1 + draws)),
            )
        )
    return tuple(chosen)


Key = tuple[str, str, tuple[int, int], int | None]


def _cells(problem: Problem) -> tuple[FloatArray, list[Key]]:
    """Sums over (capture, sample) x band, over repeats and by repeat; (cells, n) and labels."""
    wavelengths, channels = problem.value.shape
    rows, keys = [], []
    repeats: list[int | None] = [None]
    if len(problem.repeats) > 1:
        repeats += problem.repeats
    for (capture, sample), repeat in product(problem.blocks, repeats):
        here = np.array([(c.capture, c.sample) == (capture, sample) for c in problem.channels])
        own = here & np.array([repeat is None or c.repeat == repeat for c in problem.channels])
        # A repeat of its own is judged against the mean of all.
        weight = own / max(own.sum(), 1) - (0.0 if repeat is None else here / max(here.sum(), 1))
        for parts in BANDS:
            if parts > wavelengths:
                continue
            for part, inside in enumerate(np.array_split(np.arange(wavelengths), parts)):
                row = np.zeros((wavelengths, channels))
                row[inside] = weight
                rows.append(row.ravel())
                keys.append((capture, sample, (parts, part), repeat))
    return np.array(rows), keys


Label = tuple[tuple[str, ...], tuple[str, ...], tuple[int, int], int | None]


def _overlap(labels: list[Label], one: Label) -> np.ndarray:
    """Blocks that hold, or are held by, a stronger one and so tell nothing new."""

    def within(a: Label, b: Label) -> bool:
        low, high = a[2][1] / a[2][0], (a[2][1] + 1) / a[2][0]
        inside = b[2][1] / b[2][0] <= low + 1e-9 and high <= (b[2][1] + 1) / b[2][0] + 1e-9
        return (
            (not b[0] or a[0] == b[0])
            and (not b[1] or a[1] == b[1])
            and inside
            and (b[3] is None or a[3] == b[3])
        )

    return np.array([within(label, one) or within(one, label) for label in labels])


def enters(problem: Problem, null: Fit) -> tuple[Entry, ...]:
    """Every block that can be left out, the ones that heal most of the rest first."""
    shapes = polynomials(problem.wavelength_nm, SMOOTH)
    single = smooth_columns(problem, null.predicted, shapes, by="channel")
    whole = smooth_columns(problem, null.predicted, shapes)
    channel_columns, block_columns = null.reduction(single), null.reduction(whole)
    parts = [block_columns]
    if len(problem.repeats) > 1:
        parts.append(
            null.reduction(
                smooth_columns(problem, null.predicted, shapes[:, :2], by="capture_repeat")
            )
        )
    every = orthonormal(np.concatenate(parts, axis=1))
    total = float(np.sum((every.T @ null.residual) ** 2))
    excess = max(total - every.shape[1], 1e-9)
    count = shapes.shape[1]
    result = []
    for captures, samples, repeat in _removable(problem):
        if repeat is None:
            rows = [
                i for i, (c, s) in enumerate(problem.blocks)
                if (not captures or c in captures) and (not samples or s in samples)
            ]  # fmt: skip
            source = block_columns
        else:
            rows = [i for i, c in enumerate(problem.channels) if c.repeat == repeat]
            source = channel_columns
        own = orthonormal(source[:, [i * count + k for i in rows for k in range(count)]])
        rest = orthonormal_rest(every, own)
        left = float(np.sum((rest.T @ null.residual) ** 2))
        missed = float(np.sum((own.T @ null.residual) ** 2))
        p_rest = float(chi2.sf(left, rest.shape[1])) if rest.shape[1] else 1.0
        result.append(
            Entry(
                captures=captures,
                samples=samples,
                repeat=repeat,
                missed=float(chi2.sf(missed, max(own.shape[1], 1))),
                rest=p_rest,
                healed=float(np.clip(1.0 - (left - rest.shape[1]) / excess, 0.0, 1.0)),
                # Where nothing is left that could show a gap, nothing has been healed.
                heals=bool(p_rest > HEALED and rest.shape[1] > 0),
            )
        )
    return tuple(
        sorted(
            result, key=lambda e: (not e.heals, bool(not e.captures) + bool(not e.samples), -e.rest)
        )
    )


def orthonormal_rest(every: FloatArray, own: FloatArray) -> FloatArray:
    """Basis of what a span has outside another, shape (n, rank)."""
    left = off(every, own)
    value, vector = np.linalg.eigh(left.T @ left)
    kept = value > 1e-6
    return np.asarray(left @ (vector[:, kept] / np.sqrt(value[kept])))


def _removable(problem: Problem) -> list[tuple[tuple[str, ...], tuple[str, ...], int | None]]:
    captures = list(dict.fromkeys(c.capture for c in problem.channels))
    samples = list(dict.fromkeys(c.sample for c in problem.channels))
    result: list[tuple[tuple[str, ...], tuple[str, ...], int | None]] = []
    result += [((c,), (s,), None) for c, s in problem.blocks]
    result += [((c,), (), None) for c in captures if len(captures) > 1]
    result += [((), (s,), None) for s in samples if len(samples) > 1]
    if len(problem.repeats) > 1:
        result += [((), (), r) for r in problem.repeats]
    return result
