"""The quantities that a person moves: names, ranges, and the scale of their sliders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from twin.errors import InputError

Scale = Literal["linear", "logarithm", "albedo"]


LEAST_N = 1.0001
"""Least refractive index. At exactly 1 the fast engine is another program, which would have to be
compiled too; this one differs from it by 1e-4, its own error."""


@dataclass(frozen=True)
class Slider:
    """One slider: a quantity between two values on a scale.

    Attributes:
        name: of the field of `Settings`.
        label: what the page calls it.
        unit: behind the value, or "".
        low, high: least and greatest value.
        scale: positions are values, decadic logarithms of them, or -log10(1 - value).
        step: of the position.
        digits: significant digits of the value shown, or decimals on a linear scale.
        hint: what it is, in a sentence.
    """

    name: str
    label: str
    unit: str
    low: float
    high: float
    scale: Scale
    step: float
    digits: int
    hint: str

    def position(self, value: float) -> float:
        """Where the slider stands for a value; beyond the ends: at the end."""
        inside = min(max(value, self.low), self.high)
        if self.scale == "logarithm":
            return math.log10(inside)
        return -math.log10(1.0 - inside) if self.scale == "albedo" else inside

    def value(self, position: float) -> float:
        """The value at a position of the slider."""
        if self.scale == "logarithm":
            found = math.pow(10.0, position)
        else:
            found = 1.0 - math.pow(10.0, -position) if self.scale == "albedo" else position
        # the ends themselves, not what rounding makes of them
        return min(max(found, self.low), self.high)


SLIDERS = (
    Slider("albedo", "Albedo", "", 0.0, 0.9999, "albedo", 0.005, 4,
           "Share of the extinction that is scattering."),
    Slider("sigma_t_per_mm", "Extinction σt", "/mm", 0.05, 100.0, "logarithm", 0.005, 3,
           "Extinction coefficient: one over the mean free path."),
    Slider("g", "Anisotropy g", "", -0.5, 0.95, "linear", 0.005, 3,
           "Mean cosine of the scattering angle."),
    Slider("thickness_mm", "Thickness", "mm", 0.05, 20.0, "logarithm", 0.005, 3,
           "Of the chosen sample; the other samples of the visit keep their ratio to it."),
    Slider("n", "Refractive index n", "", LEAST_N, 1.8, "linear", 0.005, 3,
           "Of the sample. The least, 1.0001, gives what 1 gives within 1e-4."),
    Slider("rho_black", "Black background", "", 0.0, 0.5, "linear", 0.001, 3,
           "Reflectance of the black background."),
    Slider("rho_white", "White background", "", 0.5, 0.999, "linear", 0.001, 3,
           "Reflectance of the white background."),
    Slider("acceptance_deg", "Aperture", "°", 0.1, 20.0, "logarithm", 0.005, 2,
           "Half-angle of the detector's cone: how much scattered light the collimated capture"
           " takes for transmitted."),
    Slider("averages", "Averages", "frames", 1.0, 1000.0, "logarithm", 0.05, 3,
           "Frames averaged into one capture: shot and read noise fall with their root, the"
           " lamps' drift does not."),
)  # fmt: skip
"""In the order of the page."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Where everything on the page stands.

    Attributes:
        material: name of one of the source's spectra.
        wavelength: index of the wavelength at which the sliders' values hold.
        sample: index of the sample of which map, captures and colours are shown.
        albedo, sigma_t_per_mm, g, n, rho_black, rho_white: at that wavelength; [1/mm] for
            sigma_t. The rest of the material's spectrum moves along.
        thickness_mm: of that sample [mm].
        acceptance_deg: half-angle of the detector's cone [deg].
        averages: frames of one capture.
        all_samples: the uncertainty is that of the whole visit, else of this sample alone.
        drift: whether lamps drift and flicker.
    """

    material: str
    wavelength: int
    sample: int
    albedo: float
    sigma_t_per_mm: float
    g: float
    thickness_mm: float
    n: float
    rho_black: float
    rho_white: float
    acceptance_deg: float
    averages: int
    all_samples: bool = True
    drift: bool = True

    @classmethod
    def of(cls, asked: Mapping[str, Any]) -> Settings:
        """Settings as a page sends them: slider positions, and the choices by their names.

        Raises:
            InputError: a missing key, something that is no number, or a position beyond the ends.
        """
        values: dict[str, Any] = {}
        for slider in SLIDERS:
            position = _number(asked, slider.name)
            low, high = slider.position(slider.low), slider.position(slider.high)
            if not low - slider.step <= position <= high + slider.step:
                raise InputError(
                    f"{position:g}", f"a position from {low:g} to {high:g}", place=slider.name
                )
            values[slider.name] = slider.value(position)
        values["averages"] = round(values["averages"])
        for name in ("wavelength", "sample"):
            values[name] = int(_number(asked, name))
        for name in ("all_samples", "drift"):
            values[name] = bool(asked.get(name, True))
        return cls(material=str(asked.get("material", "")), **values)

    def positions(self) -> dict[str, float]:
        """Position of every slider by its name."""
        return {slider.name: slider.position(getattr(self, slider.name)) for slider in SLIDERS}


def _number(asked: Mapping[str, Any], name: str) -> float:
    value = asked.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{value!r}", "a number", place=name)
    return float(value)
