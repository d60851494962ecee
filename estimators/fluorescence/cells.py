"""Captures as linear equations in the cells of the matrix, checked, for a batch of samples."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.result import BoolArray
from twin.errors import InputError
from twin.fluorescence.system import FluorescenceData, FluorescenceSystem
from twin.spectra import FloatArray

ASSUMED_NOISE = 1e-3
"""Standard deviation over the brightest capture where a variance of zero is stated."""


@dataclass(frozen=True, eq=False)
class Cells:
    """The unknown cells of a matrix: C strictly longer than the excitation, D on the diagonal.

    Attributes:
        emission_nm: (Wo,); excitation_nm: (Wi,).
    """

    emission_nm: FloatArray
    excitation_nm: FloatArray

    @cached_property
    def below_diagonal(self) -> BoolArray:
        """Cells of fluorescence, shape (Wo, Wi): emission longer than excitation."""
        return np.asarray(self.emission_nm[:, None] > self.excitation_nm + 1e-6)

    @cached_property
    def diagonal(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns (D,) of the reflectance."""
        row, column = np.nonzero(np.abs(self.emission_nm[:, None] - self.excitation_nm) < 1e-6)
        return row, column

    @cached_property
    def emission(self) -> FloatArray:
        """Emission wavelength [nm] of every fluorescence cell, (C,)."""
        return np.asarray(self.emission_nm[np.nonzero(self.below_diagonal)[0]])

    @cached_property
    def excitation(self) -> FloatArray:
        """Excitation wavelength [nm] of every fluorescence cell, (C,)."""
        return np.asarray(self.excitation_nm[np.nonzero(self.below_diagonal)[1]])

    @cached_property
    def diagonal_nm(self) -> FloatArray:
        """Wavelengths [nm] of the diagonal, (D,)."""
        return np.asarray(self.emission_nm[self.diagonal[0]])

    def matrix(self, fluorescence: FloatArray, reflectance: FloatArray) -> FloatArray:
        """Matrices (..., Wo, Wi) of cells (..., C) and diagonals (..., D)."""
        out = np.zeros((*reflectance.shape[:-1], *self.below_diagonal.shape))
        out[..., self.below_diagonal] = fluorescence
        out[..., self.diagonal[0], self.diagonal[1]] = reflectance
        return out


@dataclass(frozen=True, eq=False)
class Captures:
    """Captures of B samples of one set-up with the same valid ones (M of J K).

    Attributes:
        system: the set-up; cells: the unknowns.
        value: (B, M); covariance: (B, M, M); valid: (J K,).
        assumed: whether noise had to be assumed, (B,).
    """

    system: FluorescenceSystem
    cells: Cells
    value: FloatArray
    covariance: FloatArray
    valid: BoolArray
    assumed: BoolArray

    @cached_property
    def design(self) -> FloatArray:
        """Captures of every cell of the whole matrix, shape (M, Wo, Wi)."""
        shape = (-1, self.cells.emission_nm.size, self.cells.excitation_nm.size)
        return np.asarray(self.system.design().reshape(shape)[self.valid])

    @cached_property
    def fluorescence_design(self) -> FloatArray:
        """Shape (M, C)."""
        return np.asarray(self.design[:, self.cells.below_diagonal])

    @cached_property
    def diagonal_design(self) -> FloatArray:
        """Shape (M, D)."""
        return np.asarray(self.design[:, self.cells.diagonal[0], self.cells.diagonal[1]])

    def full(self, values: FloatArray) -> FloatArray:
        """Valid values (M,) as (J, K) with NaN elsewhere."""
        out = np.full(self.valid.size, np.nan)
        out[self.valid] = values
        return out.reshape(len(self.system.illuminants), -1)


def checked(data: FluorescenceData) -> None:
    """Refuse captures that no estimator can use; `FluorescenceData` checked their numbers.

    Raises:
        InputError: a sensor and illuminants that do not overlap; captures all zero.
    """
    system = data.system
    emission, excitation = system.emission_nm, system.excitation_nm
    on = np.abs(emission[:, None] - excitation) < 1e-6
    longer = emission[:, None] > excitation - 1e-6
    light = system.illuminants.max(axis=0) / system.illuminants.max()
    sight = system.sensitivities.max(axis=0) / system.sensitivities.max()
    seen = sight[:, None] * light
    if not on.any() or seen[longer].max() < 1e-9:
        raise InputError(
            "illuminants and channels without a wavelength in common, or channels that only see"
            " wavelengths shorter than all light",
            "channels that see wavelengths as long as the light or longer",
            place="system",
            remedy="Are sensitivities and illuminants in the wrong order, or on other wavelengths?",
        )
    valid = data.valid
    if not np.any(np.abs(data.value[valid]) > 0.0):
        raise InputError("captures that are all zero", "light that comes back", place="value")


def gather(data: Sequence[FluorescenceData]) -> Captures:
    """Several samples of one set-up with the same valid captures.

    Raises:
        InputError: none at all, other set-ups or other valid captures, or what `checked` refuses.
    """
    if not data:
        raise InputError("no sample", "one or more", place="data")
    first = data[0]
    values, covariances, assumed = [], [], []
    for one in data:
        checked(one)
        if not _same(one.system, first.system) or not np.array_equal(one.valid, first.valid):
            raise InputError(
                f"sample {one.sample!r} of another set-up or with other valid captures",
                "one set-up", place="data",
            )  # fmt: skip
        valid = one.valid.reshape(-1)
        value = one.value.reshape(-1)[valid]
        common = one.common.reshape(len(one.common), valid.size)[:, valid]
        covariance = np.diag(one.variance.reshape(-1)[valid]) + common.T @ common
        extra = assumed_variance(one)
        floor = 1e-14 * np.abs(value).max() ** 2
        values.append(value)
        covariances.append(covariance + np.diag(extra + floor))
        assumed.append(bool(extra.any()))
    cells = Cells(first.system.emission_nm, first.system.excitation_nm)
    return Captures(
        first.system, cells, np.array(values), np.array(covariances),
        first.valid.reshape(-1), np.array(assumed),
    )  # fmt: skip


def assumed_variance(data: FluorescenceData) -> FloatArray:
    """What is added to the variance of the M valid captures where zero is stated, (M,)."""
    valid = data.valid
    silent = data.variance[valid] <= 0.0
    if silent.any():  # else the errors in common, which are many, need not be added
        silent &= (data.common[:, valid] ** 2).sum(axis=0) <= 0.0
    return np.where(silent, (ASSUMED_NOISE * np.abs(data.value[valid]).max()) ** 2, 0.0)


def groups(data: Sequence[FluorescenceData]) -> list[list[int]]:
    """Indices of the samples that can be gathered together."""
    found: list[list[int]] = []
    for index, one in enumerate(data):
        for group in found:
            other = data[group[0]]
            if _same(one.system, other.system) and np.array_equal(one.valid, other.valid):
                group.append(index)
                break
        else:
            found.append([index])
    return found


def _same(one: FluorescenceSystem, other: FluorescenceSystem) -> bool:
    if one is other:
        return True
    names = ("illuminants", "sensitivities", "emission_nm", "excitation_nm")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def fingerprint(data: FluorescenceData, name: str, settings: Mapping[str, object]) -> str:
    """SHA-256 of the captures, the set-up, the estimator's name and its settings."""
    digest = hashlib.sha256()
    system = data.system
    arrays = (
        data.value, data.variance, data.common, data.valid, system.illuminants,
        system.sensitivities, system.emission_nm, system.excitation_nm,
    )  # fmt: skip
    for array in arrays:
        block = np.ascontiguousarray(array)
        digest.update(f"{block.dtype.str}{block.shape}".encode())
        digest.update(block.tobytes())
    words = (data.sample, name, *(f"{key}={settings[key]!r}" for key in sorted(settings)))
    for word in words:
        digest.update(word.encode() + b"\0")
    return digest.hexdigest()
