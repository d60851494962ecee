"""Every picture of the documents is shown somewhere, and the command that makes it is named."""

from __future__ import annotations

import re
import runpy

import pytest
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml

from tests.docs.pages import ROOT, pages
from tests.docs.running import parse_benchtwin

DOCS = ROOT / "docs"
LIST = (DOCS / "figures_commands.md").read_text(encoding="utf-8")
ROWS = [line for line in LIST.splitlines() if line.startswith("| `")]
PICTURES = runpy.run_path(str(DOCS / "pictures.py"))["PICTURES"]


def names_in(row: str) -> list[str]:
    """Pictures that a row of the list is about."""
    return re.findall(r"`([\w.]+\.(?:png|svg))`", row.split("|")[1])


def test_every_picture_is_in_the_list() -> None:
    files = {path.name for path in (DOCS / "images").iterdir() if path.suffix in {".png", ".svg"}}
    vectors = {name.removesuffix(".svg") for name in files if name.endswith(".svg")}
    # A figure's PNG is the same picture as its SVG.
    files -= {f"{name}.png" for name in vectors}
    assert sorted(name for row in ROWS for name in names_in(row)) == sorted(files)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: names_in(row)[0])
def test_every_picture_is_shown_and_its_command_exists(row: str) -> None:
    shown = "".join(page.read_text(encoding="utf-8") for page in pages())
    for name in names_in(row):
        assert f"images/{name})" in shown, f"no page shows {name}"
    commands = re.findall(r"`(benchtwin [^`]+)`", row)
    assert commands, f"no command in {row}"
    for command in commands:
        parse_benchtwin(command.split())


def test_pictures_are_made_by_commands_that_exist() -> None:
    listed = {name for row in ROWS for name in names_in(row)}
    for name, picture in PICTURES.items():
        assert name in listed
        for command in picture.commands:
            parse_benchtwin(command.split())
        for source in picture.inputs:
            page, _, file = source.partition(": ")
            assert f"\n# {file}\n" in (DOCS / page).read_text(encoding="utf-8")


def formulas(text: str) -> list[str]:
    """What stands between dollars, outside of code."""
    text = re.sub(r"```.*?```|`[^`]*`", "", text, flags=re.DOTALL)
    found = re.findall(r"\$\$(.*?)\$\$|(?<!\$)\$([^$]+)\$", text, re.DOTALL)
    return [block or within for block, within in found]


def test_every_formula_can_be_shown_without_a_network() -> None:
    shown = [one for page in pages() for one in formulas(page.read_text(encoding="utf-8"))]
    assert len(shown) > 20
    for formula in shown:
        assert tex2mathml(formula).startswith("<math")
    with pytest.raises(MathError):
        tex2mathml(r"\nonsense")


def test_the_example_file_is_that_of_the_tutorial() -> None:
    page = (DOCS / "tutorial_first_measurement.md").read_text(encoding="utf-8")
    shown = page.split("# first.toml\n")[1].split("```")[0]
    assert (DOCS / "examples" / "first.toml").read_text(encoding="utf-8").endswith(f"\n{shown}")
