"""From estimates to appearance: slabs of any thickness, mixtures, colours, media for renderers.

`medium_of(result)` turns an estimate into a medium with draws, `mix_media` mixes several,
`predict` says their spectral reflectance and `colour_of` their colour, each with intervals.
Names load when they are first used, so that the command line starts at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenarios.predict.appearance import Prediction, Slab, predict, reflectance_45_0
    from scenarios.predict.checker import Checker, Patch, run_checker
    from scenarios.predict.colour import Colour, colour_of, difference
    from scenarios.predict.draws import medium_of
    from scenarios.predict.export import (
        RenderMedium,
        mitsuba_text,
        pbrt_text,
        read_pbrt,
        render_medium,
        write_medium,
    )
    from scenarios.predict.mixture import UncertainMedium, mix_media, mix_properties

_HOME = {
    "Checker": "checker",
    "Colour": "colour",
    "Patch": "checker",
    "Prediction": "appearance",
    "RenderMedium": "export",
    "Slab": "appearance",
    "UncertainMedium": "mixture",
    "colour_of": "colour",
    "difference": "colour",
    "medium_of": "draws",
    "mitsuba_text": "export",
    "mix_properties": "mixture",
    "mix_media": "mixture",
    "pbrt_text": "export",
    "predict": "appearance",
    "read_pbrt": "export",
    "reflectance_45_0": "appearance",
    "render_medium": "export",
    "run_checker": "checker",
    "write_medium": "export",
}

__all__ = [
    "Checker",
    "Colour",
    "Patch",
    "Prediction",
    "RenderMedium",
    "Slab",
    "UncertainMedium",
    "colour_of",
    "difference",
    "medium_of",
    "mitsuba_text",
    "mix_media",
    "mix_properties",
    "pbrt_text",
    "predict",
    "read_pbrt",
    "reflectance_45_0",
    "render_medium",
    "run_checker",
    "write_medium",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenarios.predict' has no attribute {name!r}")
    return getattr(import_module(f"scenarios.predict.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
