"""Figures of chapters 4 and 5 again, and numbers for what the chapters say in words.

`make_figures` writes figure 2, 4, 5 and 6 (Iser et al. 2022) as SVG and PNG, and figures.json
with the checks that docs/figures.md quotes. `make_fluorescence_figures` does so for figures 7 to 10
of the fluorescence (Iser et al. 2023; docs/figures_fluorescence.md).
"""

from __future__ import annotations

from scenarios.figures.fluorescence import FLUORESCENCE_FIGURES, make_fluorescence_figures
from scenarios.figures.make import FIGURES, make_figures

__all__ = ["FIGURES", "FLUORESCENCE_FIGURES", "make_figures", "make_fluorescence_figures"]
