"""Sphinx settings: MyST pages, furo, no network."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

# The packages, whose public names are shown, and the directive that shows them.
sys.path[:0] = [str(Path(__file__).parent.parent), str(Path(__file__).parent)]

_metadata = tomllib.loads(
    (Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8")
)["project"]

project = _metadata["name"]
author = _metadata["authors"][0]["name"]
copyright = f"2026, {author}"
release = version = _metadata["version"]

extensions = ["myst_parser", "public_names", "mathml"]
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "examples", "decisions/template.md"]
# Links to files of the repository (examples, sources) are for reading there; the contract tests
# check that they lead somewhere.
suppress_warnings = ["myst.xref_missing"]

html_theme = "furo"
html_title = f"{project} {release}"
