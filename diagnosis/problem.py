"""What a diagnosis starts from: data with their covariance, a twin that predicts them, suspects.

A problem is generic: the translucent bench, integrating spheres and the fluorescence bench differ
in their channels and in the number P of unknowns of the material, and in nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from twin.errors import InputError
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

EffectValues = Mapping[str, FloatArray]
"""Deviation from nominal of every effect at work, by `Candidate.name`, each of shape (k,)."""

Forward = Callable[[FloatArray, EffectValues], FloatArray]
"""Material (W, P) and effects to the expected data (W, M)."""

Jacobian = Callable[[FloatArray, EffectValues], FloatArray]
"""Material (W, P) and effects to the derivatives of the data by the material, (W, M, P)."""


@dataclass(frozen=True)
class Channel:
    """One spectrum of the observation vector.

    Attributes:
        capture: what was captured, such as "black".
        sample: name of the sample.
        repeat: 0, 1, 2...
    """

    capture: str
    sample: str
    repeat: int = 0

    def __str__(self) -> str:
        return f"{self.capture} of {self.sample}, repeat {self.repeat}"


@dataclass(frozen=True)
class Candidate:
    """An effect that may be at work; it owns k neighbouring columns of the signatures.

    Attributes:
        effect: name in the catalogue.
        instance: what it acts on where there are several (a sample's name), or "".
        parameters: k names.
        units: k units.
        prior_scale: k magnitudes [the parameter's unit] that would not surprise, above 0.
        sign: k of +1 (never below nominal), -1 (never above) or 0.
        limit: k largest deviations from nominal that can be asked of the twin; (): 10 prior
            scales.
        even: k times whether the data follow the square of the deviation; (): none does.
        weight: prior weight of the effect relative to the other effects; the instances of an
            effect share it.
    """

    effect: str
    instance: str = ""
    parameters: tuple[str, ...] = ("value",)
    units: tuple[str, ...] = ("",)
    prior_scale: tuple[float, ...] = (1.0,)
    sign: tuple[int, ...] = (0,)
    limit: tuple[float, ...] = ()
    even: tuple[bool, ...] = ()
    weight: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what no evidence can be computed with."""
        count = len(self.parameters)
        if not count or {len(self.units), len(self.prior_scale), len(self.sign)} != {count}:
            raise InputError(
                f"{count} parameters, {len(self.units)} units, {len(self.prior_scale)} prior"
                f" scales and {len(self.sign)} signs",
                "one of each for every parameter",
                place=self.name,
            )
        if not all(np.isfinite(s) and s > 0 for s in self.prior_scale):
            raise InputError(f"prior scales {self.prior_scale}", "numbers above 0", place=self.name)
        if len(self.even) not in (0, count):
            raise InputError(
                f"{len(self.even)} times whether a parameter is even", f"none or {count}",
                place=self.name,
            )  # fmt: skip
        if not set(self.sign) <= {-1, 0, 1}:
            raise InputError(f"signs {self.sign}", "-1, 0 or 1", place=self.name)

    @property
    def name(self) -> str:
        """Unique name: the effect, with its instance in brackets."""
        return f"{self.effect}[{self.instance}]" if self.instance else self.effect

    @property
    def size(self) -> int:
        """Number k of parameters."""
        return len(self.parameters)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest coordinate of every parameter, (k,) each."""
        reach = np.array(self.limit or tuple(10.0 * scale for scale in self.prior_scale))
        reach = np.where(self._even, reach**2 / np.array(self.prior_scale), reach)
        sign = np.array(self.sign)
        return np.where(sign > 0, 0.0, -reach), np.where(sign < 0, 0.0, reach)

    @property
    def _even(self) -> BoolArray:
        return np.array(self.even or (False,) * self.size, dtype=bool)

    def physical(self, coordinate: FloatArray) -> FloatArray:
        """Deviations from nominal [the parameters' units] of coordinates of a fit, shape (..., k).

        Data are all but linear in the coordinate q, which is the deviation v itself or, of an
        even parameter, v |v| over the prior scale: there v has no slope at nominal to start from.
        One prior scale is one in both.
        """
        given, scale = np.asarray(coordinate, dtype=np.float64), np.array(self.prior_scale)
        return np.where(self._even, np.sign(given) * np.sqrt(np.abs(given) * scale), given)

    def with_response_error(
        self, coordinate: FloatArray, sd: FloatArray, relative: float
    ) -> FloatArray:
        """Standard errors of coordinates, (k,), with the relative one of the deviations added."""
        own = relative * np.where(self._even, 2.0, 1.0) * np.abs(coordinate)
        return np.asarray(np.hypot(sd, own))

    def physical_sd(self, coordinate: FloatArray, sd: FloatArray) -> FloatArray:
        """Standard errors of deviations, of coordinates and their standard errors, (k,) each.

        Of an even parameter that is not told from nominal: the deviation at one standard error.
        """
        value = np.maximum(np.abs(self.physical(coordinate)), np.abs(self.physical(sd)))
        slope = np.array(self.prior_scale) / (2.0 * np.where(value > 0.0, value, 1.0))
        return np.asarray(np.where(self._even, slope, 1.0) * sd)


@dataclass(frozen=True)
class Smoothness:
    """Gaussian-process prior of the material's spectra, squared exponential.

    Attributes:
        length_nm: correlation length [nm].
        sd: prior standard deviation of every coordinate about its mean over wavelength, P of
            them, in the coordinates of the fit.
        nugget: standard deviation that is independent at every wavelength, P of them.
    """

    length_nm: float
    sd: tuple[float, ...]
    nugget: tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """Data, covariance, prediction and suspects of one measurement.

    The covariance of the flattened data is blockdiag(independent) + sum_k c_k c_k' with c_k =
    common[k].ravel().

    Attributes:
        wavelength_nm: increasing wavelengths [nm], shape (W,).
        channels: M labels.
        value: data, shape (W, M); anything where not valid.
        valid: False where masked, shape (W, M).
        independent: covariance of what is independent between wavelengths, shape (W, M, M).
        common: rank-one modes shared by all wavelengths, shape (K, W, M); K may be 0.
        material: start of the fit in its own coordinates, shape (W, P).
        forward: material and effects to the expected data, (W, M).
        jacobian: the same arguments to derivatives by the material, (W, M, P).
        signatures: change of the data per unit of every effect parameter at the no-effect fit,
            shape (E, W, M), E the sum of the candidates' sizes, in their order.
        candidates: the catalogue.
        thickness_mm: thickness [mm] by sample, where samples have one; it tells whether two
            samples are really two.
        material_prior: a smoothness prior to compare the verdict with, or none.
        material_names: names of the P coordinates.
        material_reach: largest magnitudes of the P coordinates that a fit goes to; (): any.
        response_error: relative standard error of the twin's responses to effects, which the values
            that are fitted with them share.
        one_material: whether all samples are one, under different lights: what they share is
            its own then, not the bench's.
    """

    wavelength_nm: FloatArray
    channels: tuple[Channel, ...]
    value: FloatArray
    valid: BoolArray
    independent: FloatArray
    common: FloatArray
    material: FloatArray
    forward: Forward
    jacobian: Jacobian
    signatures: FloatArray
    candidates: tuple[Candidate, ...]
    thickness_mm: Mapping[str, float] = field(default_factory=dict)
    material_prior: Smoothness | None = None
    material_names: tuple[str, ...] = ()
    material_reach: tuple[float, ...] = ()
    response_error: float = 0.0
    one_material: bool = False

    def __post_init__(self) -> None:
        """Refuse shapes that do not belong together."""
        wavelengths, channels = len(self.wavelength_nm), len(self.channels)
        columns = sum(candidate.size for candidate in self.candidates)
        shape = (wavelengths, channels)
        expected = {
            "value": shape,
            "valid": shape,
            "independent": (*shape, channels),
            "common": (len(self.common), *shape),
            "signatures": (columns, *shape),
            "material": (wavelengths, np.shape(self.material)[-1]),
        }
        for name, wanted in expected.items():
            found = np.shape(getattr(self, name))
            if found != wanted:
                raise InputError(f"shape {found}", f"shape {wanted}", place=name)
        names = [candidate.name for candidate in self.candidates]
        if len(set(names)) < len(names):
            double = sorted({name for name in names if names.count(name) > 1})
            raise InputError(f"several candidates {', '.join(double)}", "unique names")
        known = self.valid & np.isfinite(self.value)
        if not np.array_equal(known, self.valid):
            raise InputError(
                f"{int(np.sum(self.valid & ~known))} valid data that are no numbers",
                "valid False where there is no number",
                place="valid",
            )

    @property
    def columns(self) -> tuple[tuple[int, ...], ...]:
        """The columns of the signatures that every candidate owns."""
        ends = np.cumsum([candidate.size for candidate in self.candidates])
        return tuple(
            tuple(range(int(end) - candidate.size, int(end)))
            for end, candidate in zip(ends, self.candidates, strict=True)
        )

    @property
    def blocks(self) -> tuple[tuple[str, str], ...]:
        """The distinct (capture, sample) of the channels, in order of appearance."""
        return tuple(dict.fromkeys((c.capture, c.sample) for c in self.channels))

    @property
    def repeats(self) -> tuple[int, ...]:
        """The distinct repeats, increasing."""
        return tuple(sorted({channel.repeat for channel in self.channels}))


@dataclass(frozen=True, eq=False, kw_only=True)
class Extra:
    """A capture that could be made next, as further channels of a problem.

    Attributes:
        name: what to do, in words.
        cost: of any unit, above 0 (minutes, say).
        channels: N labels.
        independent: covariance independent between wavelengths, shape (W, N, N).
        common: the problem's K modes continued into these channels and further ones of their
            own, shape (K + L, W, N).
        jacobian: derivatives by the material at the fit, shape (W, N, P).
        signatures: shape (E, W, N).
    """

    name: str
    cost: float
    channels: tuple[Channel, ...]
    independent: FloatArray
    common: FloatArray
    jacobian: FloatArray
    signatures: FloatArray
