"""Set-ups of a design study: the file is read, and one is picked on the page."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.explorer import browser, chromium
from scenarios.design.candidate import Candidate
from scenarios.design.parts import load_parts
from scenarios.explore.design import Design, read_design
from scenarios.explore.model import Explorer
from scenarios.explore.setups_figure import ALL, front_figure
from twin.errors import InputError

PARTS = (
    "white-leds-2", "printed-panels", "two-holes", "ptfe-sheet", "flocked-paper", "as7341",
    "hand-slide", "ruler-spacers",
)  # fmt: skip
TARGETS = {"albedo": 0.002, "g": 0.03}


def row(figures: tuple[float, float], thickness_mm: tuple[float, ...], white: str) -> Any:
    own = Candidate(tuple(white if name == "ptfe-sheet" else name for name in PARTS), thickness_mm)
    library = load_parts()
    named = dict(zip(TARGETS, figures, strict=True))
    return {
        "id": own.id(library), "price_usd": own.price(library), "figures": named,
        "score": max(value / TARGETS[name] for name, value in named.items()),
        "parts": list(own.parts), "thickness_mm": list(own.thickness_mm),
        "averages": own.averages, "repeats": own.repeats, "acceptance_deg": own.acceptance_deg,
        "polar_deg": own.polar_deg, "leds": own.leds,
    }  # fmt: skip


def facts() -> dict[str, Any]:
    cheap = row((0.003, 0.036), (0.3, 1.2), "ptfe-sheet")
    answer = row((0.0015, 0.027), (0.3, 0.6, 1.2), "ptfe-sheet")
    dear = row((0.0010, 0.020), (0.3, 0.6, 1.2), "ptfe-compared")
    bad = row((0.004, 0.050), (0.3, 0.6), "ptfe-sheet")
    return {
        "title": "A goal", "reached": True, "targets": TARGETS, "answer": answer,
        "search": {"method": "exhaustive", "complete": True, "candidates": 99},
        "limits": {"albedo": {"n": 0.2, "rho_white_relative": 0.7}, "g": {"thickness_mm": 0.9}},
        "front": [cheap, answer, dear], "greedy": [bad, answer],
        "compared": [{"name": "seed", "price_usd": 2628.0,
                      "figures": {"albedo": 0.0007, "g": 0.016}}],
        "robust": [{"id": answer["id"], "figures": {
            name: {"predicted": 0.0, "with_effects": 0.005} for name in TARGETS}}],
        "verified": [{"id": answer["id"], "ratio": {"albedo": 1.02}, "agrees": True}],
    }  # fmt: skip


@pytest.fixture
def design(tmp_path: Path) -> Design:
    (tmp_path / "design.json").write_text(json.dumps(facts()))
    return read_design(tmp_path)


def test_a_study_is_read_with_the_prices_of_its_parts(design: Design) -> None:
    assert [each.on_front for each in design.setups].count(False) == 1
    own = design.setup(design.answer)
    used = 3 * sum(load_parts().part(name).per_sample_usd for name in PARTS)
    assert sum(part.price_usd or 0.0 for part in own.parts) + used == own.price_usd
    assert list(own.limits["albedo"]) == ["rho_white_relative", "n"]
    assert (own.effects["g"], own.simulated) == (0.005, {"albedo": 1.02})
    (better,) = design.better(own)
    assert own.changes(better) == ["ptfe-sheet → ptfe-compared"]
    assert design.better(better) == ()
    assert design.compared[0].score == pytest.approx(0.016 / 0.03)


def test_a_figure_without_effects_keeps_the_columns(tmp_path: Path) -> None:
    pytest.importorskip("dash", reason="the extra explore is not installed: no page")
    from scenarios.explore.panels import html_of
    from scenarios.explore.setups import card

    known = facts()
    del known["robust"][0]["figures"]["g"]
    (tmp_path / "design.json").write_text(json.dumps(known))
    design = read_design(tmp_path)
    table = html_of(card(design, design.setup(design.answer))[1])
    rows = [row.count("<td") for row in table.split("<tr>")[2:]]
    assert rows == [table.count("<th ") + table.count("<th>")] * 2
    assert ">–</td>" in table


def test_prices_of_other_parts_are_those_of_the_scenario_file(tmp_path: Path) -> None:
    """A study with parts of one's own has other ids than our list gives."""
    text = json.dumps(facts()).replace(facts()["answer"]["id"], "aaaaaaaaaaaa")
    (tmp_path / "design.json").write_text(text)
    unknown = read_design(tmp_path).setup("aaaaaaaaaaaa")
    assert {part.price_usd for part in unknown.parts} == {None}
    (tmp_path / "candidates").mkdir()
    head = "".join(f"# Title {k}: {k + 0.5:g} USD (a drawer (mine))\n" for k in range(8))
    (tmp_path / "candidates" / "aaaaaaaaaaaa.toml").write_text(f"# Design a: 36 USD\n{head}x = 1\n")
    own = read_design(tmp_path).setup("aaaaaaaaaaaa")
    assert [part.price_usd for part in own.parts] == [k + 0.5 for k in range(8)]
    assert (own.parts[0].title, own.parts[0].source) == ("Title 0", "a drawer (mine)")


@pytest.mark.parametrize("text", ["[1]", "no", '{"verdict": "no_gap"}', '{"targets": {"g": "x"}}'])
def test_another_file_is_refused_in_one_message(tmp_path: Path, text: str) -> None:
    file = tmp_path / "other.json"
    file.write_text(text)
    with pytest.raises(InputError, match="no design study") as caught:
        read_design(file)
    assert "design.json of benchtwin design" in str(caught.value)


def test_the_picture_has_front_target_answer_and_choice(design: Design) -> None:
    own = design.setups[0]
    for name, target in ((ALL, 1.0), *TARGETS.items()):
        figure = front_figure(design, own, name)
        others, line, front, beside, answer, chosen = figure["data"]
        assert line["y"] == sorted(line["y"], reverse=True)
        assert front["x"] == sorted(front["x"])
        assert answer["customdata"] == [design.answer]
        assert (chosen["x"], chosen["customdata"]) == ([own.price_usd], [own.id])
        assert (len(others["x"]), beside["x"]) == (1, [2628.0])
        assert figure["layout"]["shapes"][0]["y0"] == target
        assert figure["layout"]["xaxis"]["type"] == "log"


def test_the_target_is_named_beside_its_line(design: Design) -> None:
    own = design.setup(design.answer)
    logarithmic = front_figure(design, own, "albedo")["layout"]
    assert logarithmic["annotations"][0]["y"] == pytest.approx(math.log10(TARGETS["albedo"]))
    exact = replace(own, figures={**own.figures, "albedo": 0.0})
    others = tuple(each for each in design.setups if each.id != own.id)
    linear = front_figure(replace(design, setups=(*others, exact)), exact, "albedo")["layout"]
    assert linear["annotations"][0]["y"] == TARGETS["albedo"]


def test_a_set_up_is_picked_on_the_page(design: Design, explorer: Explorer) -> None:
    pytest.importorskip("dash", reason="the extra explore is not installed: no page")
    pytest.importorskip("playwright", reason="the extra browser is not installed")
    if chromium() is None:
        pytest.skip("no Chromium on this machine")
    with served(explorer, design) as address, browser() as opened:
        page = opened.new_page(viewport={"width": 1280, "height": 800})
        complaints: list[str] = []
        page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
        page.goto(address)
        page.click("#tabs label:has-text('Set-ups')")
        card = page.locator("#setup-card")
        card.wait_for()
        assert "rho_white_relative 70\u00a0%" in card.inner_text()
        assert "1.35 times better" in card.inner_text()
        dear = design.setups[-1]
        page.wait_for_function(DRAWN)
        x, y = page.evaluate(DOT, dear.id)
        page.mouse.click(x, y)
        page.wait_for_function(
            "document.querySelector('#setup-card').innerText.includes('compared once')"
        )
        assert "Nothing that was looked at is more accurate" in card.inner_text()
        assert dear.id in page.inner_text("#setup")
        page.click("#setup-figure label:has-text('Albedo')")
        page.wait_for_function(
            "document.querySelector('#setup-plot .js-plotly-plot').layout.shapes[0].y0 < 0.01"
        )
        assert page.evaluate("document.documentElement.scrollHeight") <= 800
        assert page.evaluate("document.documentElement.scrollWidth") <= 1280
        assert complaints == []


DRAWN = """() => {
  const traces = document.querySelectorAll('#setup-plot .scatterlayer .trace');
  return traces.length > 2 && traces[2].querySelectorAll('path.point').length > 0;
}"""
DOT = """id => {
  const graph = document.querySelector('#setup-plot .js-plotly-plot');
  const at = graph.data[2].customdata.indexOf(id);
  const traces = graph.querySelectorAll('.scatterlayer .trace');
  const dot = traces[2].querySelectorAll('path.point')[at].getBoundingClientRect();
  return [dot.x + dot.width / 2, dot.y + dot.height / 2];
}"""


@contextmanager
def served(explorer: Explorer, design: Design) -> Iterator[str]:
    from scenarios.explore.app import application
    from scenarios.explore.server import free_port, serve
    from scenarios.explore.setups import setups_moves, setups_part

    app = application(explorer, extra={"Set-ups": setups_part(design)})
    setups_moves(app, design)
    port = free_port(None)[0]
    server = serve(app, port)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{port}/"
    finally:
        server.shutdown()
        thread.join(timeout=10)
        server.server_close()
