"""Chapter 4's figures again, with our Monte Carlo, and numbers for what it says in words.

`make_figures` writes figure 2, 4, 5 and 6 (Iser et al. 2022) as SVG and PNG, and figures.json
with the checks that docs/figures.md quotes.
"""

from __future__ import annotations

from scenarios.figures.make import FIGURES, make_figures

__all__ = ["FIGURES", "make_figures"]
