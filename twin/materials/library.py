"""The library: every name, and the functions that turn a person's spectrum into arrays."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from twin.bench import Medium
from twin.errors import InputError
from twin.materials import lamps
from twin.materials.absorbers import ABSORBERS
from twin.materials.backgrounds import REFLECTANCES
from twin.materials.composition import EXAMPLE, is_composition, parse
from twin.materials.entry import (
    Entry,
    evaluate,
    require_bounds,
    require_range,
    unknown_name,
    wavelengths,
)
from twin.materials.glasses import REFRACTIVE_INDICES
from twin.materials.inks import INKS, MEASURED_MEDIA
from twin.materials.material import Material, OpticalProperties, Share, mixture, ratio
from twin.materials.scatterers import SCATTERERS
from twin.spectra import FloatArray, Spectral, SpectralTable

Kind = Literal["refractive_index", "reflectance", "lamp", "material"]
"""What the library holds."""

_PURE: dict[str, Material] = {**SCATTERERS, **ABSORBERS, **INKS, **MEASURED_MEDIA}

COMPOSED: dict[str, str] = {
    "intralipid": "intralipid_20",
    "demo_ink": "intralipid_20(2.4%) + methylene_blue(40 umol/l) + carmoisine(150 umol/l)",
}
"""Materials that are a composition of others, by name."""

MATERIAL_NAMES: tuple[str, ...] = (*COMPOSED, *_PURE)
"""Every material's name."""


def names(kind: Kind) -> tuple[str, ...]:
    """The names of one kind: "refractive_index", "reflectance", "lamp" or "material".

    Raises:
        InputError: another kind.
    """
    if kind == "refractive_index":
        return tuple(REFRACTIVE_INDICES)
    if kind == "reflectance":
        return tuple(REFLECTANCES)
    if kind == "lamp":
        return lamps.NAMES
    if kind == "material":
        return MATERIAL_NAMES
    raise InputError(f'the kind "{kind}"', f"one of {', '.join(get_args(Kind))}")


def entry(kind: Kind, name: str) -> Entry | Material:
    """The library's entry of a name: its citation, its range and what to know about it.

    Raises:
        InputError: an unknown kind or name; the message lists those that look like it.
    """
    if kind == "refractive_index":
        return _find("refractive index", REFRACTIVE_INDICES, name)
    if kind == "reflectance":
        return _find("reflectance", REFLECTANCES, name)
    if kind == "lamp":
        return lamps.lamp_entry(name)
    if kind == "material":
        return material(name)
    raise InputError(f'the kind "{kind}"', f"one of {', '.join(get_args(Kind))}")


def refractive_index(value: Spectral, wavelength_nm: ArrayLike) -> FloatArray:
    """Refractive index, shape (W,), of a number, table or name at wavelengths [nm], shape (W,).

    Raises:
        InputError: an unknown name, a wavelength outside the source, an index outside 1 to 5.
    """
    wavelength = wavelengths(wavelength_nm)
    index = evaluate(
        value,
        wavelength,
        "refractive index",
        lambda name: _find("refractive index", REFRACTIVE_INDICES, name),
    )
    return require_bounds("the refractive index", index, wavelength, 1.0, 5.0)


def reflectance(value: Spectral, wavelength_nm: ArrayLike) -> FloatArray:
    """Reflectance, shape (W,), of a number, table or name at wavelengths [nm], shape (W,).

    Raises:
        InputError: an unknown name, a wavelength outside the source, a value outside 0 to 1.
    """
    wavelength = wavelengths(wavelength_nm)
    found = evaluate(
        value,
        wavelength,
        "reflectance",
        lambda name: _find("reflectance", REFLECTANCES, name),
    )
    return require_bounds("the reflectance", found, wavelength, 0.0, 1.0)


def lamp(value: Spectral, wavelength_nm: ArrayLike) -> FloatArray:
    """Relative spectral power per nm, shape (W,), at wavelengths [nm], shape (W,).

    Tables and names are divided by their peak between 380 and 780 nm; a number is the same power
    at every wavelength, 1.

    Raises:
        InputError: an unknown name, a wavelength outside the source, a power below 0, no light.
    """
    wavelength = wavelengths(wavelength_nm)
    if isinstance(value, SpectralTable):
        value = lamps.lamp_table(value)
    elif not isinstance(value, str):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"the lamp {value:g}", "a spectral power above 0")
        value = 1.0
    return evaluate(value, wavelength, "lamp", lamps.lamp_entry)


def material(name: str) -> Material:
    """The material of a library name or of a composition such as "intralipid(4%)".

    Raises:
        InputError: an unknown name (the message lists those that look like it), a composition
            that cannot be read or mixed.
    """
    text = name.strip()
    if not is_composition(text):
        if text in COMPOSED:
            composed = material(COMPOSED[text])
            return dataclasses.replace(composed, name=text)
        if text not in _PURE:
            raise unknown_name("the material", text, MATERIAL_NAMES)
        return _PURE[text]
    shares = []
    for ingredient in parse(text):
        part = material(ingredient.name)
        if ingredient.measure != part.measure:
            wanted = (
                "a volume fraction in %" if part.measure == "volume" else "mol/l or parts of it"
            )
            if ingredient.amount is None and part.measure == "volume":
                wanted = "an amount in parentheses"
            raise InputError(
                f'{part.name} without {wanted} in "{text}"', f"amounts as in {EXAMPLE}"
            )
        shares.append(Share(part, float(ingredient.amount or 0.0)))
    return mixture(text, shares)


def optical_properties(medium: str | Medium, wavelength_nm: ArrayLike) -> OpticalProperties:
    """Albedo, extinction and anisotropy of a medium at wavelengths [nm], shape (W,).

    Args:
        medium: a library name, a composition such as "intralipid(4%) + methylene_blue(5 umol/l)",
            or the numbers, tables and names of a `Medium` (a name there stands for that property
            of the named material).
        wavelength_nm: wavelengths [nm], shape (W,), in any order.

    Raises:
        InputError: an unknown name, a composition that cannot be read or mixed, a wavelength
            outside the source, an albedo outside 0 to 1, an extinction below 0, |g| of 1 or more,
            a second lobe that leaves no room for the first.
    """
    wavelength = wavelengths(wavelength_nm)
    if isinstance(medium, str):
        return _of_material(material(medium), wavelength)
    found = checked_properties(
        wavelength,
        _of_medium(medium.albedo, "albedo", wavelength),
        _of_medium(medium.sigma_t_per_mm, "sigma_t_per_mm", wavelength),
        _of_medium(medium.g, "g", wavelength),
    )
    if medium.second_share == 0.0:
        return found
    two = dataclasses.replace(found, second_share=medium.second_share, second_g=medium.second_g)
    two.require_lobes()
    return two


def checked_properties(
    wavelength_nm: FloatArray,
    albedo: FloatArray,
    sigma_t_per_mm: FloatArray,
    g: FloatArray,
    n: FloatArray | None = None,
) -> OpticalProperties:
    """The properties, each of shape (W,), when they are physical.

    Raises:
        InputError: an albedo outside 0 to 1, an extinction below 0 or |g| of 1 or more, naming
            the wavelength.
    """
    below_one = float(np.nextafter(1.0, 0.0))
    return OpticalProperties(
        wavelength_nm=wavelength_nm,
        albedo=require_bounds("the albedo", albedo, wavelength_nm, 0.0, 1.0),
        sigma_t_per_mm=require_bounds(
            "the extinction coefficient [1/mm]", sigma_t_per_mm, wavelength_nm, 0.0, math.inf
        ),
        g=require_bounds("the anisotropy factor g", g, wavelength_nm, -below_one, below_one),
        n=n,
    )


def _of_material(found: Material, wavelength: FloatArray) -> OpticalProperties:
    if found.measure == "molar":
        raise InputError(
            f"{found.name} without a concentration", f"{found.name}(5 umol/l), as in {EXAMPLE}"
        )
    sigma_a, sigma_s, g = found.at(wavelength)
    sigma_t = sigma_a + sigma_s
    index = None if found.n is None else refractive_index(found.n, wavelength)
    return checked_properties(wavelength, ratio(sigma_s, sigma_t), sigma_t, g, index)


def _of_medium(
    value: Spectral, quantity: Literal["albedo", "sigma_t_per_mm", "g"], wavelength: FloatArray
) -> FloatArray:
    if isinstance(value, str):
        array: FloatArray = getattr(_of_material(material(value), wavelength), quantity)
        return array
    if isinstance(value, SpectralTable):
        span = (value.wavelength_nm[0], value.wavelength_nm[-1])
        require_range(f"the {quantity} table", span, wavelength)
        return value.at(wavelength)
    return np.full(wavelength.shape, float(value))


def _find(kind: str, catalogue: dict[str, Entry], name: str) -> Entry:
    if name not in catalogue:
        raise unknown_name(f"the {kind}", name, tuple(catalogue))
    return catalogue[name]
