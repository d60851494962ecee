"""The forward model of the fluorescence bench, and the data that estimators get."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError
from twin.fluorescence.donaldson import GRID_NM, DonaldsonMatrix, checked_grid
from twin.spectra import FloatArray

BoolArray = NDArray[np.bool_]

UNSEEN = 1e-6
"""Light below this share of the brightest is none."""


@dataclass(frozen=True, eq=False)
class FluorescenceSystem:
    """Illuminants and sensitivities on the bins of a Donaldson matrix.

        I_jk = sum_o s_k(o) sum_i Phi[o, i] l_j(i)          (Iser et al. 2023, equation 3, summed)

    Attributes:
        illuminants: energy per excitation bin, one common scale, shape (J, Wi).
        sensitivities: signal per energy in an emission bin, shape (K, Wo).
        emission_nm: wavelengths [nm] of the emission bins, (Wo,).
        excitation_nm: wavelengths [nm] of the excitation bins, (Wi,).
        illuminant_names: J names, or () for none.
        channel_names: K names, or () for none.

    Raises:
        InputError: shapes or numbers that cannot be; an illuminant without light, a channel
            without sensitivity.
    """

    illuminants: FloatArray
    sensitivities: FloatArray
    emission_nm: FloatArray = field(default_factory=lambda: GRID_NM)
    excitation_nm: FloatArray = field(default_factory=lambda: GRID_NM)
    illuminant_names: tuple[str, ...] = ()
    channel_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        emission = checked_grid(self.emission_nm, "emission_nm")
        excitation = checked_grid(self.excitation_nm, "excitation_nm")
        object.__setattr__(self, "emission_nm", emission)
        object.__setattr__(self, "excitation_nm", excitation)
        for name, size, labels in (
            ("illuminants", excitation.size, "illuminant_names"),
            ("sensitivities", emission.size, "channel_names"),
        ):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.ndim != 2 or value.shape[1] != size or value.shape[0] == 0:
                raise InputError(
                    f"{name} of shape {value.shape}", f"one or more rows of {size} bins", place=name
                )
            if not np.all(np.isfinite(value)):
                raise InputError(f"{name} that are no number", "numbers in every bin", place=name)
            given = tuple(getattr(self, labels)) or tuple(f"{n + 1}" for n in range(len(value)))
            if len(given) != len(value):
                raise InputError(f"{len(given)} names", f"{len(value)}", place=labels)
            dark = value.max(axis=1) <= UNSEEN * value.max()
            if dark.any():
                which = given[int(np.argmax(dark))]
                raise InputError(
                    f"nothing in the bins of {name[:-1]} {which!r}",
                    "light, or sensitivity, inside the wavelengths of the matrix",
                    place=name,
                    remedy="Leave it out, or widen the wavelengths.",
                )
            value.flags.writeable = False
            object.__setattr__(self, name, value)
            object.__setattr__(self, labels, given)

    def captures(self, matrix: ArrayLike | DonaldsonMatrix) -> FloatArray:
        """Noiseless captures of a Donaldson matrix [emission, excitation] in energy units.

        Args:
            matrix: shape (..., Wo, Wi), or a `DonaldsonMatrix` on the system's wavelengths.

        Returns:
            I, shape (..., J, K).

        Raises:
            InputError: another shape, or other wavelengths.
        """
        if isinstance(matrix, DonaldsonMatrix):
            same = np.array_equal(matrix.emission_nm, self.emission_nm) and np.array_equal(
                matrix.excitation_nm, self.excitation_nm
            )
            if not same:
                matrix = matrix.on(self.emission_nm, self.excitation_nm)
            value = matrix.matrix
        else:
            value = np.asarray(matrix, dtype=np.float64)
        expected = (self.emission_nm.size, self.excitation_nm.size)
        if value.shape[-2:] != expected:
            raise InputError(f"a matrix of shape {value.shape}", f"shape {expected}")
        return np.asarray(
            np.einsum("ko,...oi,ji->...jk", self.sensitivities, value, self.illuminants)
        )

    def white(self, reflectance: ArrayLike = 1.0) -> FloatArray:
        """Captures of a white without fluorescence, reflectance scalar or (Wo,), -> (J, K)."""
        common = np.asarray(np.abs(self.emission_nm[:, None] - self.excitation_nm) < 1e-6)
        rho = np.broadcast_to(np.asarray(reflectance, float), self.emission_nm.shape)
        return self.captures(common * rho[:, None])

    def blind(self) -> BoolArray:
        """Cells on or above the diagonal that no capture depends on, shape (Wo, Wi).

        Columns that no illuminant lights and rows that no channel sees: whatever an estimate says
        there comes from its prior.
        """
        light = self.illuminants.max(axis=0)
        sight = self.sensitivities.max(axis=0)
        dark = light <= UNSEEN * light.max()
        unseen = sight <= UNSEEN * sight.max()
        possible = self.emission_nm[:, None] > self.excitation_nm[None, :] - 1e-6
        return np.asarray(possible & (unseen[:, None] | dark[None, :]))

    def design(self) -> FloatArray:
        """Derivative of the flattened captures by the flattened matrix, shape (J K, Wo Wi)."""
        product = np.einsum("ji,ko->jkoi", self.illuminants, self.sensitivities)
        return np.asarray(product.reshape(product.shape[0] * product.shape[1], -1))


@dataclass(frozen=True, eq=False)
class FluorescenceData:
    """What estimators get of one sample: captures corrected to the scale of the system.

    Attributes:
        system: calibrated illuminants (J, Wi), sensitivities (K, Wo) and their wavelengths.
        value: captures I, shape (J, K); NaN where not valid.
        variance: variance of each value that is independent of all others, shape (J, K).
        common: errors that several values share, one standard deviation each, shape (C, J, K): the
            level of an illuminant, the gain of a channel, the drift of a lamp.
        valid: shape (J, K).
        reasons: what was masked and assumed, in words with counts.
        common_names: C names.
        sample: name of the sample.
        truth: of a simulated visit, the matrix that was simulated (its wavelengths may be more).

    Raises:
        InputError: shapes or numbers that cannot be.
    """

    system: FluorescenceSystem
    value: FloatArray
    variance: FloatArray
    common: FloatArray
    valid: BoolArray
    reasons: tuple[str, ...] = ()
    common_names: tuple[str, ...] = ()
    sample: str = ""
    truth: DonaldsonMatrix | None = None

    def __post_init__(self) -> None:
        shape = (len(self.system.illuminants), len(self.system.sensitivities))
        valid = np.array(self.valid, dtype=bool)
        value = np.array(self.value, dtype=np.float64)
        variance = np.array(self.variance, dtype=np.float64)
        common = np.array(self.common, dtype=np.float64).reshape(-1, *shape)
        for name, array in (("value", value), ("variance", variance), ("valid", valid)):
            if array.shape != shape:
                raise InputError(f"{name} of shape {array.shape}", f"shape {shape}", place=name)
        if not valid.any():
            raise InputError("no valid capture", "one or more", place="valid")
        if not np.all(np.isfinite(value[valid])):
            raise InputError("a valid capture that is no number", "a number", place="value")
        if not np.all(np.isfinite(variance[valid]) & (variance[valid] >= 0.0)):
            raise InputError(
                "a noise variance that is negative or no number", "0 or more", place="variance"
            )
        if not np.all(np.isfinite(common[:, valid])):
            raise InputError("a common error that is no number", "numbers", place="common")
        for name, array in (("value", value), ("variance", variance), ("common", common)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "valid", valid)

    @property
    def illuminants(self) -> FloatArray:
        """Illuminants of the system, (J, Wi)."""
        return self.system.illuminants

    @property
    def sensitivities(self) -> FloatArray:
        """Sensitivities of the system, (K, Wo)."""
        return self.system.sensitivities

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the flattened values (index j K + k), shape (J K, J K); NaN if invalid."""
        spread = self.common.reshape(len(self.common), self.value.size)
        total = np.diag(self.variance.reshape(-1)) + spread.T @ spread
        hidden = ~self.valid.reshape(-1)
        total[hidden] = np.nan
        total[:, hidden] = np.nan
        return np.asarray(total)


def plain_data(
    system: FluorescenceSystem,
    matrix: DonaldsonMatrix,
    *,
    relative_noise: float = 2e-3,
    floor: float = 2e-4,
    seed: int = 1,
) -> FluorescenceData:
    """Captures with simple noise, without an instrument: for tests and quick studies.

        sigma_jk^2 = (relative_noise I_jk)^2 + (floor max I)^2, independent

    Raises:
        InputError: noise of 0 or below; other wavelengths.
    """
    if not (relative_noise >= 0.0 and floor > 0.0 and np.isfinite(relative_noise + floor)):
        raise InputError(
            f"relative_noise {relative_noise:g}, floor {floor:g}",
            "a noise of 0 or more and a floor above 0", place="noise",
        )  # fmt: skip
    clean = system.captures(matrix)
    sigma = np.sqrt((relative_noise * clean) ** 2 + (floor * clean.max()) ** 2)
    normal = np.random.Generator(np.random.Philox(key=seed)).standard_normal(clean.shape)
    return FluorescenceData(
        system,
        clean + sigma * normal,
        sigma**2,
        np.zeros((0, *clean.shape)),
        np.ones(clean.shape, dtype=bool),
        sample=matrix.name,
        truth=matrix,
    )
