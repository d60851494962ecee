"""A slightly rough surface as a thin cover that scatters forwards.

Roughness spreads a share of the light that crosses the surface over small angles and absorbs
nothing. A cover of negligible thickness under the smooth surface, of the index of what lies
below, does the same: the share exp(-tau) of a crossing at the normal is not scattered. What it
leaves out: light that the surface itself reflects stays specular, and oblique light is spread
a little more than by a real surface (its way through the cover is longer). Interfaces stay
smooth in the transport (`twin.transport`), which sees covers of every kind.
"""

from __future__ import annotations

import math

from twin.bench import Bench, Layer, Medium
from twin.errors import InputError
from twin.spectra import Spectral

HAZE_MM = 1e-3


def hazed(bench: Bench, haze: float, g: float = 0.96, *, n: Spectral | None = None) -> Bench:
    """The bench with a rough upper surface of the stack.

    Args:
        bench: the bench; a cover on top gives up the thickness of the haze, 0.001 mm.
        haze: share of the light at the normal that one crossing scatters, 0 to below 1.
        g: mean cosine of the scattering inside the stack. Of what is scattered, the share within
            an angle is that of Henyey and Greenstein (1941): for 0.96, half within 4 degrees
            inside the stack.
        n: refractive index of what lies below; None takes that of the upper cover.

    Raises:
        InputError: a haze or g out of range; no index for a bare sample; an upper cover thinner
            than the haze.
    """
    if not 0.0 <= haze < 1.0:
        raise InputError(f"a haze of {haze:g}", "0 to below 1", place="haze")
    if not 0.0 <= g <= 0.995:
        raise InputError(f"a haze with g {g:g}", "0 to 0.995", place="g")
    if haze == 0.0:
        return bench
    covers = bench.covers_above
    if covers and n is None:
        top = covers[0]
        if top.medium is not None or top.thickness_mm <= HAZE_MM:
            raise InputError(
                "an upper cover that scatters or is thinner than the haze",
                f"a clear cover of more than {HAZE_MM:g} mm",
                place="covers_above",
                remedy="Give the index n under the rough surface",
            )
        n = top.n
        thinner = top.model_copy(update={"thickness_mm": top.thickness_mm - HAZE_MM})
        covers = (thinner, *covers[1:])
    if n is None:
        raise InputError("a bare sample", "its refractive index", place="n")
    medium = Medium(albedo=1.0, sigma_t_per_mm=-math.log1p(-haze) / HAZE_MM, g=g)
    rough = Layer(thickness_mm=HAZE_MM, n=n, medium=medium)
    return bench.model_copy(update={"covers_above": (rough, *covers)})
