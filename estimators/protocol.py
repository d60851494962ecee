"""What goes into an estimator, and what an estimator is."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from estimators.map_grid import Map
from estimators.result import EstimateResult
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities
from twin.optics import Windows, windows
from twin.spectra import FloatArray


@runtime_checkable
class Estimator(Protocol):
    """Measurement in, material with uncertainty out."""

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        ...

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Estimate the material behind the relative intensities of one visit.

        A wavelength that cannot be used gets a status, never an exception.

        Raises:
            twin.errors.InputError: the intensities as a whole cannot be used.
        """
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class BenchModel:
    """What an estimator knows of the bench: everything but the material."""

    sample_names: tuple[str, ...]
    wavelength_nm: FloatArray
    """Wavelengths [nm], shape (W,)."""
    n: FloatArray
    """Refractive index of every sample, shape (S, W)."""
    rho_black: FloatArray
    """Reflectance of the black background, shape (W,)."""
    rho_white: FloatArray
    """Reflectance of the white background, shape (W,)."""
    covers_above: tuple[FloatArray, ...] = ()
    """Refractive indices of the covers above, top to bottom, each of shape (W,)."""
    covers_below: tuple[FloatArray, ...] = ()
    maps: tuple[Map, ...] = ()
    """One appearance map per sample, or none."""
    bench: Bench | None = None
    """The bench itself, for estimators that have an engine of their own; None: unknown."""
    samples: tuple[Sample, ...] = ()
    """The samples as they were described; their material is never looked at."""

    @classmethod
    def of(
        cls,
        bench: Bench,
        samples: Sequence[Sample],
        wavelength_nm: FloatArray,
        maps: Sequence[Map] = (),
    ) -> BenchModel:
        """Look the bench's spectra up at the wavelengths (W,) [nm] of the intensities."""
        from twin.materials import reflectance, refractive_index

        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        return cls(
            sample_names=tuple(sample.name for sample in samples),
            wavelength_nm=wavelength,
            n=np.stack([refractive_index(sample.n, wavelength) for sample in samples]),
            rho_black=reflectance(bench.background.black.reflectance, wavelength),
            rho_white=reflectance(bench.background.white.reflectance, wavelength),
            covers_above=tuple(refractive_index(c.n, wavelength) for c in bench.covers_above),
            covers_below=tuple(refractive_index(c.n, wavelength) for c in bench.covers_below),
            maps=tuple(maps),
            bench=bench,
            samples=tuple(sample.model_copy(update={"material": None}) for sample in samples),
        )

    def windows(self, sample: int) -> Windows:
        """Faces and covers around one sample at normal incidence, shape (W,)."""
        return windows(self.n[sample], self.covers_above, self.covers_below)

    def check(self, intensities: RelativeIntensities) -> None:
        """Make sure that intensities belong to this model.

        Raises:
            InputError: other samples or wavelengths, wrong shapes, or wavelengths that are
                not finite and increasing.
        """
        wavelength = np.asarray(intensities.wavelength_nm)
        if not np.isfinite(wavelength).all() or np.any(np.diff(wavelength) <= 0):
            raise InputError(
                "wavelengths that are not finite or do not increase",
                "finite, increasing wavelengths [nm]",
                place="wavelength_nm",
            )
        if tuple(intensities.sample_names) != self.sample_names:
            raise InputError(
                f"samples {', '.join(intensities.sample_names)}",
                f"samples {', '.join(self.sample_names)}, as the bench was described",
                place="sample_names",
            )
        if wavelength.shape != self.wavelength_nm.shape or not np.array_equal(
            wavelength, self.wavelength_nm
        ):
            raise InputError(
                f"{wavelength.size} wavelengths that are not those of the bench model",
                f"its {self.wavelength_nm.size} wavelengths",
                place="wavelength_nm",
            )
        samples, count = len(self.sample_names), wavelength.size
        expected = {
            "value": (samples, 3, count),
            "covariance": (count, 3 * samples, 3 * samples),
            "valid": (samples, 3, count),
            "thickness_mm": (samples,),
        }
        for field, shape in expected.items():
            found = np.shape(getattr(intensities, field))
            if found != shape:
                raise InputError(f"shape {found}", f"shape {shape}", place=field)
        thickness = np.asarray(intensities.thickness_mm)
        if not (np.isfinite(thickness).all() and (thickness > 0).all()):
            raise InputError(
                f"thicknesses {thickness.tolist()} mm", "lengths above 0 mm", place="thickness_mm"
            )

    def fingerprint_parts(self) -> list[FloatArray]:
        """Every array but the maps, of shape (W,) or (S, W), for `fingerprint`."""
        return [
            self.wavelength_nm,
            self.n,
            self.rho_black,
            self.rho_white,
            *self.covers_above,
            *self.covers_below,
        ]


def fingerprint(
    intensities: RelativeIntensities, parts: Iterable[FloatArray], words: Iterable[str]
) -> str:
    """SHA-256 over intensities, further arrays and further words."""
    digest = hashlib.sha256()
    arrays = [
        intensities.thickness_mm,
        intensities.wavelength_nm,
        intensities.value,
        intensities.covariance,
        intensities.valid,
        *parts,
    ]
    for array in arrays:
        block = np.ascontiguousarray(array)
        digest.update(f"{block.dtype.str}{block.shape}".encode())
        digest.update(block.tobytes())
    for word in (*intensities.sample_names, *words):
        digest.update(word.encode() + b"\0")
    return digest.hexdigest()
