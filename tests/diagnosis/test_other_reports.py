"""Reports of fluorescence visits and of integrating spheres: one page each, nothing left out.

The first runs the command of docs/diagnosis_fluorescence.md.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from diagnosis import Diagnosis
from diagnosis.spheres import SphereCase
from scenarios.report_diagnosis import headline
from scenarios.report_diagnosis.other_page import TITLES, sphere_names, sphere_page
from scenarios.report_diagnosis.words import UNDER_LIGHTS, place_text
from tests.diagnosis.fluorescence_visits import visit
from tests.diagnosis.test_spheres import control, judged
from tests.scenarios.tiny import answer, call

LEAK = 0.06
ONE_ROW = """IAD1
1.4 1.5 1.0 1.0 0.0 0.99 0
2
0.4 0.3
"""


def closed(page: str) -> None:
    """One file that fetches nothing and shows no embedded image."""
    assert "<script" not in page
    assert "<image" not in page
    assert not re.search(r'(?:src|href)="(?!#)', page)


@pytest.fixture(scope="module")
def leak(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str]:
    """What the command answers to a visit with a leaking filter, and its page."""
    from twin.fluorescence import example, named_setup, write_visit

    base = tmp_path_factory.mktemp("leak")
    disturbed = visit(named_setup("l1-s2"), example("pink_paper"), 3, [("filter_leak", 2, LEAK)])
    write_visit(disturbed, base / "visit.nc")
    page = base / "page.html"
    result = call(
        "diagnose", base / "visit.nc", "--report", page, "--out", base / "out", "--json", "-q"
    )
    found = answer(result)
    assert found["report"] == str(page)
    assert [path.name for path in (base / "out").iterdir()] == ["diagnosis.json"]
    assert json.loads((base / "out" / "diagnosis.json").read_text("utf-8")) == {
        key: value for key, value in found.items() if key not in ("folder", "report")
    }
    return found, unescape(page.read_text("utf-8"))


def test_a_fluorescence_page_holds_verdict_effects_and_pictures(
    leak: tuple[dict[str, Any], str],
) -> None:
    found, page = leak
    assert found["leading"] == ["filter_leak[illuminant 3]"]
    assert found["sentence"] in page
    assert "a filter lets other light through (illuminant 3: cyan)" in page
    every = [each["name"] for key in ("effects", "not_identifiable") for each in found[key]]
    assert len(every) > 20
    assert [name for name in every if name not in page] == []
    for name in ("residual-maps", "evidence", "separations", "closure", "matrix", "rest"):
        assert f'id="{name}-' in page, name
    assert "under all lights" in page
    assert "of all samples" not in page
    assert "What to measure next" not in page
    closed(page)


def _with_diluent(case: SphereCase, absorption: float) -> SphereCase:
    """The case with readings that an absorption of the diluent has moved."""
    problem = case.problem
    names = [each.name for each in problem.candidates]
    moved = absorption * problem.signatures[names.index("diluent_absorption")]
    return replace(case, problem=replace(problem, value=problem.value + moved))


def test_dilutions_get_a_page_with_every_effect_and_its_plain_name() -> None:
    case = _with_diluent(control(), 0.08)
    found = judged(case)
    named = sphere_names([each.name for each in case.problem.candidates])
    page = sphere_page(
        case, found, named, heading="stock.rxt", fingerprint="0" * 64, reasons=case.reasons
    )
    assert headline(found, named) in unescape(page)
    assert "all dilutions share an absorption" in page
    shown = [e.name for e in found.effects] + [e.name for e in found.not_identifiable]
    assert [name for name in shown if name not in page] == []
    assert 'id="residual-maps-' in page
    assert "Autocorrelation" not in page
    assert "ln sigma_t" in page
    closed(page)
    nothing = Diagnosis(verdict="cannot_tell", reason="no light")
    page = sphere_page(case, nothing, named, heading="<dark>", fingerprint="", reasons=())
    assert "Cannot tell: no light." in page
    assert "&lt;dark&gt;" in page


def test_every_effect_of_the_spheres_has_plain_words() -> None:
    from diagnosis.sphere_effects import CATALOGUE

    assert TITLES.keys() == {effect.name for effect in CATALOGUE}
    assert sphere_names(["dark_offset[M_R]"])("dark_offset[M_R]").endswith("twice (M_R)")


def test_one_sample_gets_a_page_that_says_what_to_measure(tmp_path: Path) -> None:
    file = tmp_path / "one.rxt"
    file.write_text(ONE_ROW, encoding="utf-8")
    found = answer(call("diagnose", file, "--out", tmp_path / "out", "--json", "-q"))
    assert found["verdict"] == "cannot_tell"
    page = (tmp_path / "out" / "diagnosis.html").read_text("utf-8")
    assert "Measure at least two more thicknesses" in page
    assert "slide_index" in page
    assert 'href="#where"' not in page
    closed(page)


def test_places_are_said_as_the_bench_has_them() -> None:
    from diagnosis.where import Block

    block = Block(("white",), ("cyan",), None, None, 5.0, 0.01)
    assert place_text(block) == "white of cyan"
    assert place_text(block, UNDER_LIGHTS) == "white under cyan"
