"""docs/estimators.md: its tables hold every estimator and every status."""

from __future__ import annotations

import re

from estimators import Status
from estimators.registry import _OURS as OURS
from scenarios.describe import catalogue
from scenarios.estimator_notes import NOTES
from tests.contract.repository import ROOT

PAGE = (ROOT / "docs" / "estimators.md").read_text(encoding="utf-8")


def first_cells() -> list[str]:
    """Names between backticks in the first cell of every row of a table."""
    rows = re.findall(r"^\| (`.*?`) \|", PAGE, re.MULTILINE)
    return [name for row in rows for name in re.findall(r"`(.*?)`", row)]


def test_the_tables_are_complete():
    statuses = [status.name.lower() for status in Status]
    assert sorted(first_cells()) == sorted([*OURS, *statuses])


def test_every_estimator_has_a_line_in_the_list():
    assert set(NOTES) == set(OURS)
    shown = catalogue("estimators")["estimators"]
    assert all(shown[name] == line for name, line in NOTES.items())


def test_the_command_page_names_every_command():
    from typer.main import get_command

    from scenarios.cli import app

    text = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    named = set(re.findall(r"^    benchtwin ([a-z]+)", text, re.MULTILINE))
    assert named == set(get_command(app).commands)
