"""One named spectrum of the library, and how a person's spectrum becomes an array.

Everything that the refractive indices, the backgrounds and the lamps share: a name with its
citation and range, the message for an unknown name, and the check that values are physical.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError
from twin.spectra import FloatArray, Spectral, SpectralTable


@dataclass(frozen=True)
class Entry:
    """A published or stated spectrum.

    Attributes:
        name: name in the library.
        citation: author, year, and where in the publication.
        range_nm: first and last wavelength [nm] that can be asked for.
        value: values, shape (W,), at wavelengths [nm], shape (W,), inside the range.
        approximation: True when the numbers are ours, stated in `note`, and not a published table
            or formula.
        assumed_nm: parts of `range_nm` beyond the source, in which the values are a stated
            assumption.
        note: what a user has to know.
    """

    name: str
    citation: str
    range_nm: tuple[float, float]
    value: Callable[[FloatArray], FloatArray]
    approximation: bool = False
    assumed_nm: tuple[tuple[float, float], ...] = ()
    note: str = ""

    def at(self, wavelength_nm: ArrayLike) -> FloatArray:
        """Values, shape (W,), at wavelengths [nm], shape (W,).

        Raises:
            InputError: a wavelength lies outside `range_nm`: nothing is extrapolated.
        """
        wavelength = wavelengths(wavelength_nm)
        require_range(self.name, self.range_nm, wavelength)
        return self.value(wavelength)


def wavelengths(wavelength_nm: ArrayLike) -> FloatArray:
    """Wavelengths [nm] as a float64 array, shape (W,), in the given order.

    Raises:
        InputError: more than one dimension, no value, a value that is not a number above 0.
    """
    try:
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(f"wavelengths {wavelength_nm!r}", "numbers [nm]") from error
    if wavelength.ndim != 1 or wavelength.size == 0:
        raise InputError(f"wavelengths of shape {wavelength.shape}", "a list of one or more [nm]")
    bad = ~(np.isfinite(wavelength) & (wavelength > 0))
    if bad.any():
        raise InputError(f"the wavelength {wavelength[bad][0]:g} nm", "wavelengths above 0 nm")
    return wavelength


def require_range(name: str, range_nm: tuple[float, float], wavelength: FloatArray) -> None:
    """Raise InputError when a wavelength [nm], shape (W,), lies outside the range of an entry."""
    low, high = range_nm
    outside = wavelength[(wavelength < low) | (wavelength > high)]
    if outside.size:
        raise InputError(
            f"{outside[0]:g} nm asked of {name}",
            f"wavelengths inside the {low:g} to {high:g} nm of its source",
            remedy="Nothing is extrapolated: narrow the wavelength grid or choose another entry.",
        )


def require_bounds(
    quantity: str, value: FloatArray, wavelength: FloatArray, low: float, high: float
) -> FloatArray:
    """`value`, shape (W,), when all of it lies inside [low, high].

    Raises:
        InputError: naming the first wavelength [nm] at which it does not.
    """
    bad = ~((value >= low) & (value <= high))
    if bad.any():
        index = int(np.argmax(bad))
        bounds = f"{low:g} or more" if np.isinf(high) else f"{low:g} to {high:g}"
        raise InputError(f"{quantity} {value[index]:g} at {wavelength[index]:g} nm", bounds)
    return value


def unknown_name(kind: str, name: str, known: Sequence[str]) -> InputError:
    """The error for a name that is not in the library, with the names that look like it."""
    folded = {candidate.casefold(): candidate for candidate in known}
    near = difflib.get_close_matches(name.strip().casefold(), folded, n=3, cutoff=0.5)
    remedy = f"Did you mean {' or '.join(folded[key] for key in near)}? " if near else ""
    return InputError(
        f'{kind} "{name}", which is not in the library',
        "a number, a table or a name of the library",
        remedy=f"{remedy}Names: {', '.join(known)}.",
    )


def evaluate(
    value: Spectral, wavelength_nm: ArrayLike, kind: str, find: Callable[[str], Entry]
) -> FloatArray:
    """A number, a table or a library name at wavelengths [nm], shape (W,).

    Args:
        value: what a person wrote.
        wavelength_nm: wavelengths [nm], shape (W,).
        kind: what the value is, for messages ("reflectance").
        find: the entry of a name; raises InputError for an unknown one.

    Raises:
        InputError: an unknown name, or a wavelength outside the table or the entry.
    """
    wavelength = wavelengths(wavelength_nm)
    if isinstance(value, str):
        return find(value).at(wavelength)
    if isinstance(value, SpectralTable):
        span = (value.wavelength_nm[0], value.wavelength_nm[-1])
        require_range(f"the {kind} table", span, wavelength)
        return value.at(wavelength)
    return np.full(wavelength.shape, float(value))


def table(text: str) -> SpectralTable:
    """A table typed as "wavelength value wavelength value ...": how the library keeps figures."""
    numbers = [float(word) for word in text.split()]
    return SpectralTable(wavelength_nm=tuple(numbers[::2]), value=tuple(numbers[1::2]))


def tabulated(
    name: str, citation: str, text: str, *, approximation: bool = False, note: str = ""
) -> Entry:
    """An entry that is linear between the samples of a table."""
    samples = table(text)
    return Entry(
        name=name,
        citation=citation,
        range_nm=(samples.wavelength_nm[0], samples.wavelength_nm[-1]),
        value=samples.at,
        approximation=approximation,
        note=note,
    )
