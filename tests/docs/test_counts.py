"""Numbers of things that pages state are those of the program."""

from __future__ import annotations

import re

import pytest

from tests.docs.pages import ROOT
from twin.effects import catalogue


@pytest.mark.parametrize("page", ["README.md", "docs/diagnosis.md"])
def test_the_number_of_effects_is_that_of_the_catalogue(page: str) -> None:
    known = [effect for effect in catalogue().effects if effect.visit == "translucent"]
    stated = re.findall(r"which of (\d+) effects", (ROOT / page).read_text(encoding="utf-8"))
    assert stated == [str(len(known))]
