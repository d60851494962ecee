"""What the page's own program keeps in the browser: positions of sliders, as plain values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from scenarios.explore.panels import figures_of, pieces
from scenarios.explore.sliders import SLIDERS, Slider
from scenarios.explore.uncertainty import PARAMETERS

if TYPE_CHECKING:
    from scenarios.explore.model import Explorer, Picture


def answer_of(explorer: Explorer, picture: Picture) -> dict[str, Any]:
    """A picture as the page's program draws it."""
    return {
        "figures": figures_of(explorer, picture),
        "pieces": pieces(explorer, picture),
        "said": "",
        "number": 0,
    }


def bases_of(explorer: Explorer) -> dict[str, Any]:
    """What the page's program needs once: sliders, wavelengths, and the described positions."""
    source = explorer.source
    by_name = {slider.name: slider for slider in SLIDERS}
    first = explorer.first()
    return {
        "sliders": {
            slider.name: {
                "scale": slider.scale, "digits": slider.digits, "unit": slider.unit,
                "low": slider.low, "high": slider.high,
            }
            for slider in SLIDERS
        },
        "wavelength_nm": [float(w) for w in source.wavelength_nm],
        "material": first.material,
        "materials": {
            name: {
                key: [_placed(by_name[key], float(v)) for v in getattr(spectrum, key)]
                for key in PARAMETERS
            }
            for name, spectrum in source.spectra.items()
        },
        "described": {
            key: [_placed(by_name[key], float(v)) for v in getattr(source, key)]
            for key in ("n", "rho_black", "rho_white")
        },
        "thickness_mm": [
            _placed(by_name["thickness_mm"], sample.thickness_mm) for sample in source.samples
        ],
        "acceptance_deg": first.positions()["acceptance_deg"],
        "averages": first.positions()["averages"],
    }  # fmt: skip


def _placed(slider: Slider, value: float) -> float:
    return round(slider.position(value), 6)
