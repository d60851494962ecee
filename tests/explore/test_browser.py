"""The page in a real headless browser; skipped where there is none."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.explorer import browser, chromium
from scenarios.explore.model import Explorer
from scenarios.explore.moves import move_cosine, move_share
from scenarios.explore.sliders import SLIDERS, Settings

dash = pytest.importorskip("dash", reason="the extra explore is not installed: no page")


@pytest.fixture(scope="module")
def port(explorer: Explorer) -> Iterator[int]:
    from scenarios.explore.app import application
    from scenarios.explore.server import free_port, serve

    chosen = free_port(None)[0]
    server = serve(application(explorer), chosen)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield chosen
    server.shutdown()
    thread.join(timeout=10)
    server.server_close()


def ask(port: int, path: str, body: Any = None, **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        if body is None:
            connection.request("GET", path, headers=named)
        else:
            named["Content-Type"] = "application/json"
            connection.request("POST", path, json.dumps(body), named)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def request_of(explorer: Explorer, **changes: float) -> dict[str, Any]:
    first = explorer.first()
    return {
        **first.positions(), "material": first.material, "wavelength": first.wavelength,
        "sample": 0, "all_samples": True, "drift": True, "number": 3, **changes,
    }  # fmt: skip


def test_other_hosts_and_other_pages_are_refused(port: int, explorer: Explorer) -> None:
    assert ask(port, "/")[0] == 200
    assert ask(port, "/", Host="evil.example")[0] == 403
    assert ask(port, "/", Host=f"evil.example:{port}")[0] == 403
    foreign = ask(port, "/picture", request_of(explorer), Origin="http://evil.example")
    assert foreign[0] == 403
    assert ask(port, "/picture", request_of(explorer))[0] == 200


def test_nothing_of_the_page_comes_from_elsewhere(port: int) -> None:
    text = ask(port, "/")[1]
    assert 'src="http' not in text
    assert 'href="http' not in text


def test_a_picture_over_the_wire_is_the_model_s(port: int, explorer: Explorer) -> None:
    status, text = ask(port, "/picture", request_of(explorer))
    answer = json.loads(text)
    x, y = (answer["figures"]["map"]["data"][-1][axis] for axis in "xy")
    assert status == 200
    assert answer["number"] == 3
    np.testing.assert_allclose((x[0], y[0]), explorer.picture(explorer.first()).point, rtol=1e-12)
    refused = json.loads(ask(port, "/picture", request_of(explorer, g=9.0))[1])
    assert "found 9" in refused["said"]
    assert "figures" not in refused
    assert "no request" in json.loads(ask(port, "/picture", [1, 2])[1])["said"]


def test_a_port_in_use_is_said(port: int) -> None:
    from scenarios.explore.server import free_port
    from twin.errors import InputError

    with pytest.raises(InputError, match="another program listens"):
        free_port(port)
    other, is_other = free_port(None)
    assert other != port
    assert is_other == (other != 8050)
    with pytest.raises(InputError, match="1 to 65535"):
        free_port(70000)


def test_what_a_person_wrote_is_escaped() -> None:
    from dash import html

    from scenarios.explore.panels import html_of

    text = html_of(html.Div(["<script>alert(1)</script>", html.B("1 < 2")], className='a"b'))
    assert "<script>" not in text
    assert text == (
        '<div class="a&#34;b">&lt;script&gt;alert(1)&lt;/script&gt;<b>1 &lt; 2</b></div>'
    )


@pytest.fixture(scope="module")
def page(port: int) -> Iterator[Any]:
    pytest.importorskip("playwright", reason="the extra browser is not installed")
    if chromium() is None:
        pytest.skip("no Chromium on this machine")
    with browser() as opened:
        shown = opened.new_page(viewport={"width": 1280, "height": 800})
        shown.seen, shown.complaints = [], []
        shown.on("request", lambda request: shown.seen.append(request.url))
        shown.on("pageerror", lambda error: shown.complaints.append(str(error)))
        shown.on(
            "console",
            lambda said: shown.complaints.append(said.text) if said.type == "error" else None,
        )
        shown.goto(f"http://127.0.0.1:{port}/")
        shown.wait_for_selector("#spectra .main-svg")
        shown.wait_for_function("document.querySelector('#tile-albedo') !== null")
        yield shown


POINT = "(() => { const d = document.querySelector('#map .js-plotly-plot').data;"
POINT += " return [d[d.length - 1].x[0], d[d.length - 1].y[0]]; })()"
CURVE = "document.querySelector('#spectra .js-plotly-plot').data[1].y"


def press(page: Any, name: str, key: str, times: int = 1) -> None:
    page.focus(f"#{name} [role=slider]")
    for _ in range(times):
        page.keyboard.press(key)


def test_a_slider_moves_picture_and_numbers(page: Any, explorer: Explorer) -> None:
    before, curve, tile = (
        page.evaluate(POINT),
        page.evaluate(CURVE),
        page.inner_text("#tile-albedo"),
    )
    assert before == pytest.approx(explorer.picture(explorer.first()).point)
    press(page, "albedo", "ArrowRight", times=40)
    page.wait_for_function(f"{POINT}[1] > {before[1] + 0.02}")
    # many moves at once: the last one wins, and picture and label agree with the engine
    settled = page.wait_for_function(
        "(() => { const t = document.querySelector('#tile-albedo').innerText.split(' ')[0];"
        " return Math.abs(Number(t) - Number(document.querySelector('#albedo-value').innerText))"
        " < 1e-3 ? t : false; })()"
    ).json_value()
    assert float(settled) > float(tile.split()[0])
    assert page.evaluate(CURVE) != curve
    assert page.inner_text("#status") == ""
    assert page.get_attribute("#albedo [role=slider]", "aria-label") == "Albedo"


def test_a_wavelength_takes_the_sliders_along(page: Any, explorer: Explorer) -> None:
    page.click("#reset")
    page.wait_for_timeout(500)
    press(page, "wavelength", "ArrowRight", times=2)
    page.wait_for_function("document.querySelector('#map-title').innerText.includes('570 nm')")
    own = explorer.source.spectra[explorer.first().material]
    page.wait_for_function(
        "Math.abs(Number(document.querySelector('#albedo-value').innerText)"
        f" - {own.albedo[17]}) < 1e-3"
    )
    x, y = explorer.picture(explorer.at(explorer.first().material, 17, 0)).point
    page.wait_for_function(f"Math.hypot({POINT}[0] - {x}, {POINT}[1] - {y}) < 1e-4")


def test_a_moved_spectrum_is_the_model_s(page: Any, explorer: Explorer) -> None:
    """Browser and model move spectra by the same rule: to another wavelength and back."""
    page.click("#reset")
    page.wait_for_timeout(500)
    press(page, "albedo", "ArrowRight", times=20)
    press(page, "g", "ArrowLeft", times=12)
    press(page, "rho_black", "ArrowRight", times=8)
    press(page, "n", "ArrowRight", times=6)
    page.wait_for_timeout(500)
    press(page, "wavelength", "ArrowLeft", times=9)
    page.wait_for_timeout(500)
    settings = {
        name: float(page.get_attribute(f"#{name} [role=slider]", "aria-valuenow"))
        for name in (slider.name for slider in SLIDERS)
    }
    here = int(page.get_attribute("#wavelength [role=slider]", "aria-valuenow"))
    first = explorer.first()
    moved = Settings.of({**settings, "material": first.material, "wavelength": here, "sample": 0})
    # the same moves made where they were made, seen from here
    own = explorer.source.spectra[first.material]
    start = here + 9
    albedo = SLIDERS[0].value(SLIDERS[0].position(own.albedo[start]) + 20 * SLIDERS[0].step)
    expected = move_share(own.albedo, start, albedo)[here]
    assert moved.albedo == pytest.approx(expected, abs=2e-3)
    assert moved.g == pytest.approx(move_cosine(own.g, start, own.g[start] - 0.06)[here], abs=6e-3)
    x, y = explorer.picture(moved).point
    page.wait_for_function(f"Math.hypot({POINT}[0] - {x}, {POINT}[1] - {y}) < 1e-3")


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1920, 1080)])
def test_everything_fits_on_the_screen(page: Any, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate("document.documentElement.scrollHeight") <= height
    below = page.evaluate(
        "['reset', 'words', 'spectra'].map(id => document.getElementById(id)"
        ".getBoundingClientRect().bottom)"
    )
    assert max(below) <= height
    assert {slider.name for slider in SLIDERS} <= set(
        page.evaluate("[...document.querySelectorAll('.slider [id]')].map(e => e.id)")
    )


def test_no_complaints_and_no_request_elsewhere(page: Any, port: int) -> None:
    assert page.complaints == []
    own = (f"http://127.0.0.1:{port}/", "data:", "blob:")
    assert page.seen
    assert [url for url in page.seen if not url.startswith(own)] == []
