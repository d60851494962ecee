"""A medium for renderers: Mitsuba 3 (Jakob et al. 2022) and pbrt-v4 (Pharr et al. 2023).

Both have a homogeneous medium with spectral coefficients but one Henyey-Greenstein g for all
wavelengths. Where the estimate's g varies, the medium gets one g (the mean weighted with the
scattering coefficient) and each scattering coefficient is rescaled so that sigma_s (1 - g) and
sigma_a stay (similarity of first order: Wyman, Patterson and Wilson 1989, Appl. Opt. 28, 5243).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.predict.mixture import ALBEDO, SIGMA_T, G, UncertainMedium
from twin.errors import InputError
from twin.files import write_atomically
from twin.spectra import FloatArray

SUFFIXES: dict[str, str] = {"mitsuba": ".xml", "pbrt": ".pbrt"}
"""Renderers and the suffixes of their files."""
_TOKEN = re.compile(r'"(?P<text>[^"\n]*)"|(?P<bracket>[\[\]])|(?P<word>[^\s"\[\]#]+)|(?P<bad>")')


@dataclass(frozen=True, eq=False)
class RenderMedium:
    """A homogeneous medium as renderers have it.

    Attributes:
        name: letters, digits, "_" and "-".
        wavelength_nm: [nm], increasing, shape (W,).
        sigma_a_per_mm: absorption coefficient [1/mm], shape (W,).
        sigma_s_per_mm: scattering coefficient [1/mm] that goes with `g`, shape (W,).
        g: anisotropy factor of all wavelengths.
        unit_mm: length of one unit of the scene [mm].
        n: refractive index, or None when nothing is said of it.
        notes: what a user has to know, as comments in the file.
    """

    name: str
    wavelength_nm: FloatArray
    sigma_a_per_mm: FloatArray
    sigma_s_per_mm: FloatArray
    g: float
    unit_mm: float = 1.0
    n: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def sigma_t_per_mm(self) -> FloatArray:
        """Extinction coefficient [1/mm], shape (W,)."""
        return self.sigma_a_per_mm + self.sigma_s_per_mm

    @property
    def albedo(self) -> FloatArray:
        """Single-scattering albedo, 0 where there is no extinction, shape (W,)."""
        total = self.sigma_t_per_mm
        return np.divide(self.sigma_s_per_mm, total, out=np.zeros_like(total), where=total > 0)


def render_medium(
    medium: UncertainMedium, *, unit_mm: float = 1.0, n: float | None = None, name: str = ""
) -> RenderMedium:
    """The medium as renderers have it, from its known wavelengths.

    Args:
        medium: a measured one or a mixture.
        unit_mm: length of one unit of the scene [mm]: 1000 for a scene in metres.
        n: refractive index for the medium's surface.
        name: in the file; "" makes one from the medium's.

    Raises:
        InputError: fewer than two known wavelengths, or a unit that is not a length.
    """
    if not (math.isfinite(unit_mm) and unit_mm > 0):
        raise InputError(f"a unit of {unit_mm:g} mm", "a length above 0 mm", place="unit")
    known = medium.known
    if known.sum() < 2:
        raise InputError(
            f"{int(known.sum())} wavelengths with a value ({medium.name})", "two or more",
            remedy="; ".join(medium.notes),
        )  # fmt: skip
    wavelength, value = medium.wavelength_nm[known], medium.value[known]
    scattering = value[:, ALBEDO] * value[:, SIGMA_T]
    absorption = (1 - value[:, ALBEDO]) * value[:, SIGMA_T]
    own = value[:, G]
    g = float(own.mean()) if scattering.sum() == 0 else float(scattering @ own / scattering.sum())
    notes = [
        f"Estimated from {wavelength[0]:g} to {wavelength[-1]:g} nm. Outside, renderers take 0:"
        " keep the light inside this range.",
        *medium.notes,
    ]
    scatters = scattering > 0
    if np.ptp(own[scatters]) > 1e-9 if scatters.any() else False:
        scattering = scattering * (1 - own) / (1 - g)
        low, high = own[scatters].min(), own[scatters].max()
        notes.append(
            f"g varies from {low:.4g} to {high:.4g}; renderers have one, so sigma_s was rescaled to"
            f" keep sigma_s (1 - g) with g {g:.4g}. For g from 0.2 to 0.6 that moves the radiance"
            " factor 45:0 by up to 0.005 in thick layers and 0.015 in thin ones."
        )
    return RenderMedium(
        re.sub(r"[^A-Za-z0-9_]+", "-", name or medium.name).strip("-") or "medium",
        wavelength, absorption, scattering, g, unit_mm, n, tuple(notes),
    )  # fmt: skip


def mitsuba_text(medium: RenderMedium) -> str:
    """A scene fragment for Mitsuba 3: the medium, and a smooth dielectric where n is known.

    Use it by <include filename="..."/> and <ref name="interior" id="NAME"/> in a shape, with a
    spectral variant: others turn the spectra into three channels.
    """
    from xml.sax.saxutils import quoteattr

    def pairs(values: FloatArray) -> str:
        both = zip(medium.wavelength_nm, values, strict=True)
        return quoteattr(", ".join(f"{float(at)!r}:{float(value)!r}" for at, value in both))

    lines = ['<scene version="3.0.0">']
    lines += [f"  <!-- {_comment(note)} -->" for note in _heading(medium)]
    lines += [
        f'  <medium type="homogeneous" id="{medium.name}">',
        f'    <spectrum name="sigma_t" value={pairs(medium.sigma_t_per_mm)}/>',
        f'    <spectrum name="albedo" value={pairs(medium.albedo)}/>',
        f'    <float name="scale" value="{medium.unit_mm!r}"/>',
        '    <phase type="hg">',
        f'      <float name="g" value="{medium.g!r}"/>',
        "    </phase>",
        "  </medium>",
    ]
    if medium.n is not None:
        lines += [
            f'  <bsdf type="dielectric" id="{medium.name}-face">',
            f'    <float name="int_ior" value="{float(medium.n)!r}"/>',
            '    <float name="ext_ior" value="1.0"/>',
            "  </bsdf>",
        ]
    return "\n".join([*lines, "</scene>", ""])


def pbrt_text(medium: RenderMedium) -> str:
    """A scene fragment for pbrt-v4, for `Include`; its media are named by MediumInterface."""

    def pairs(values: FloatArray) -> str:
        both = zip(medium.wavelength_nm, values, strict=True)
        return " ".join(f"{float(at)!r} {float(value)!r}" for at, value in both)

    lines = [f"# {_comment(note)}" for note in _heading(medium)]
    lines += [
        f'MakeNamedMedium "{medium.name}"',
        '    "string type" [ "homogeneous" ]',
        f'    "spectrum sigma_a" [ {pairs(medium.sigma_a_per_mm)} ]',
        f'    "spectrum sigma_s" [ {pairs(medium.sigma_s_per_mm)} ]',
        f'    "float g" [ {medium.g!r} ]',
        f'    "float scale" [ {medium.unit_mm!r} ]',
    ]
    if medium.n is not None:
        name = f'MakeNamedMaterial "{medium.name}-face"'
        lines += [name, f'    "string type" [ "dielectric" ] "float eta" [ {float(medium.n)!r} ]']
    return "\n".join([*lines, ""])


def write_medium(medium: RenderMedium, renderer: str, path: Path) -> Path:
    """Write the medium for a renderer, whole or not at all; the path is returned.

    Raises:
        InputError: an unknown renderer, or a folder that cannot be written.
    """
    if renderer not in SUFFIXES:
        raise InputError(f'the renderer "{renderer}"', " or ".join(SUFFIXES), place="export")
    text = mitsuba_text(medium) if renderer == "mitsuba" else pbrt_text(medium)
    return write_atomically(path, text.encode())


def _heading(medium: RenderMedium) -> tuple[str, ...]:
    return (
        f"{medium.name}: coefficients in 1/mm; one unit of the scene is {medium.unit_mm:g} mm.",
        *medium.notes,
    )


def _comment(text: str) -> str:
    """Text that closes no comment of either renderer."""
    return re.sub(r"-{2,}", "-", " ".join(text.split())).rstrip("-")


def read_pbrt(path: str | Path) -> RenderMedium:
    """Read the first homogeneous medium of a pbrt-v4 fragment as `pbrt_text` writes it.

    Raises:
        InputError: no such file, or one without a homogeneous medium with spectra in pairs.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"a file that cannot be read ({error})", "pbrt text", file=path) from error
    try:
        return parse_pbrt(text)
    except InputError as error:
        raise error.at(path) from error


def parse_pbrt(text: str) -> RenderMedium:
    """The first medium of pbrt-v4 text; see `read_pbrt`.

    Raises:
        InputError: text without a homogeneous medium with spectra in pairs.
    """
    name, values = _parameters(_tokens(text))
    if values.get("string type") != ["homogeneous"]:
        raise InputError(f"a medium of type {values.get('string type')}", "homogeneous", place=name)
    absorption, scattering = (
        _pairs(values, f"spectrum {which}") for which in ("sigma_a", "sigma_s")
    )
    if not np.array_equal(absorption[0], scattering[0]):
        raise InputError("sigma_a and sigma_s at other wavelengths", "the same", place=name)
    g, unit = (_numbers(values, key, default) for key, default in _SCALARS)
    return RenderMedium(
        name, absorption[0], absorption[1], scattering[1], float(g[0]), float(unit[0])
    )


_SCALARS = (("float g", "0"), ("float scale", "1"))


def _tokens(text: str) -> list[tuple[str, str]]:
    """Kind and text of every token; comments run to the end of their line."""
    found: list[tuple[str, str]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        for match in _TOKEN.finditer(_without_comment(line)):
            if match.lastgroup == "bad":
                raise InputError(
                    "a quotation mark without its partner", "text in quotation marks",
                    place=f"line {number}",
                )  # fmt: skip
            found.append((str(match.lastgroup), match.group(str(match.lastgroup))))
    return found


def _without_comment(line: str) -> str:
    """The line up to a # outside quotation marks."""
    inside = False
    for place, letter in enumerate(line):
        inside ^= letter == '"'
        if letter == "#" and not inside:
            return line[:place]
    return line


def _parameters(tokens: list[tuple[str, str]]) -> tuple[str, dict[str, list[str]]]:
    """Name and parameters of the first MakeNamedMedium."""
    start = next((i for i, t in enumerate(tokens) if t == ("word", "MakeNamedMedium")), None)
    if start is None or start + 1 >= len(tokens) or tokens[start + 1][0] != "text":
        raise InputError("no MakeNamedMedium with a name", 'MakeNamedMedium "name"')
    rest = iter(tokens[start + 2 :])
    values: dict[str, list[str]] = {}
    for kind, key in rest:
        if kind != "text":
            break
        items: list[str] = []
        kind, item = next(rest, ("end", ""))
        if (kind, item) == ("bracket", "["):
            for kind, item in rest:
                if kind == "bracket":
                    break
                items.append(item)
            if (kind, item) != ("bracket", "]"):
                raise InputError("a [ without its ]", "values in brackets", place=key)
        elif kind in ("text", "word"):
            items = [item]
        values[key] = items
    return tokens[start + 1][1], values


def _numbers(values: dict[str, list[str]], key: str, default: str) -> list[float]:
    try:
        numbers = [float(item) for item in values.get(key, [default])]
    except ValueError as error:
        raise InputError(f"{error}", "numbers", place=key) from error
    if not numbers or not all(math.isfinite(number) for number in numbers):
        raise InputError(f"{numbers}", "finite numbers", place=key)
    return numbers


def _pairs(values: dict[str, list[str]], key: str) -> tuple[FloatArray, FloatArray]:
    """Wavelengths and values of an inline spectrum."""
    if key not in values:
        raise InputError("no such parameter", f'"{key}" [ wavelength value ... ]', place=key)
    numbers = np.array(_numbers(values, key, ""))
    if len(numbers) < 4 or len(numbers) % 2 or np.any(np.diff(numbers[::2]) <= 0):
        raise InputError(
            f"{len(numbers)} numbers", "pairs of increasing wavelengths and values", place=key
        )
    return numbers[::2], numbers[1::2]
