"""The page in a real headless browser; skipped where there is none."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.explorer import browser, chromium, wait_until_drawn
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
        wait_until_drawn(shown)
        yield shown


POINT = "(() => { const d = document.querySelector('#map .js-plotly-plot').data;"
POINT += " return [d[d.length - 1].x[0], d[d.length - 1].y[0]]; })()"
CURVE = "document.querySelector('#spectra .js-plotly-plot').data[1].y"
TILE = "Number(document.querySelector('#tile-albedo').innerText.split(' ')[0])"
THUMBS = """names => names.map(name => {
  const thumb = document.querySelector('#' + name + ' [role=slider]');
  return [Number(thumb.ariaValueNow), parseFloat(thumb.ariaValueText)];
})"""
"""Where every slider stands, and the value that the page's program last wrote beside it."""
NAMES = [slider.name for slider in SLIDERS]


def eventually(
    page: Any, script: str, wanted: Callable[[Any], bool], argument: Any = None, seconds: float = 30
) -> Any:
    """What a script gives: the first that is wanted, or the last when the time is over."""
    end = time.monotonic() + seconds
    while not wanted(found := page.evaluate(script, argument)) and time.monotonic() < end:
        page.wait_for_timeout(20)
    return found


def press(page: Any, name: str, key: str, times: int = 1) -> None:
    page.focus(f"#{name} [role=slider]")
    for _ in range(times):
        page.keyboard.press(key)


def written(thumbs: list[tuple[float, float]]) -> bool:
    """Whether what stands beside the sliders is where they stand: the program has followed."""
    return all(
        abs(slider.position(value) - position) < 0.6 * slider.step
        for slider, (position, value) in zip(SLIDERS, thumbs, strict=True)
    )


def positions(page: Any) -> dict[str, float]:
    """Positions of the sliders, once the page's program has followed them."""
    thumbs = eventually(page, THUMBS, written, NAMES)
    assert written(thumbs), thumbs
    return {name: position for name, (position, _) in zip(NAMES, thumbs, strict=True)}


def reset(page: Any, explorer: Explorer) -> None:
    """Back to the description at the wavelength that is shown."""
    page.click("#reset")
    here = int(page.get_attribute("#wavelength [role=slider]", "aria-valuenow"))
    wanted = explorer.at(explorer.first().material, here, 0).positions()
    described = [pytest.approx(wanted[slider.name], abs=slider.step) for slider in SLIDERS]
    found = eventually(page, THUMBS, lambda t: [p for p, _ in t] == described, NAMES)
    assert [position for position, _ in found] == described


def test_a_slider_moves_picture_and_numbers(page: Any, explorer: Explorer) -> None:
    before, curve, tile = (page.evaluate(script) for script in (POINT, CURVE, TILE))
    assert before == pytest.approx(explorer.picture(explorer.first()).point)
    press(page, "albedo", "ArrowRight", times=40)
    # many moves at once: the last one wins, and picture and label agree with the engine
    albedo = SLIDERS[0].value(positions(page)["albedo"])
    assert albedo > tile + 0.05
    last = pytest.approx(albedo, abs=1e-3)
    assert eventually(page, TILE, lambda found: found == last) == last
    assert page.evaluate(POINT)[1] > before[1] + 0.02
    assert page.evaluate(CURVE) != curve
    assert page.inner_text("#status") == ""
    assert page.get_attribute("#albedo [role=slider]", "aria-label") == "Albedo"


def test_a_wavelength_takes_the_sliders_along(page: Any, explorer: Explorer) -> None:
    reset(page, explorer)
    here = int(page.get_attribute("#wavelength [role=slider]", "aria-valuenow"))
    press(page, "wavelength", "ArrowRight", times=2)
    there = explorer.at(explorer.first().material, here + 2, 0)
    point = pytest.approx(explorer.picture(there).point, abs=1e-4)
    assert eventually(page, POINT, lambda found: found == point) == point
    title = f"{explorer.source.wavelength_nm[here + 2]:.0f} nm"
    assert title in page.inner_text("#map-title")
    moved = positions(page)
    for slider in SLIDERS[:3]:
        assert moved[slider.name] == pytest.approx(
            there.positions()[slider.name], abs=0.6 * slider.step
        )


def test_a_moved_spectrum_is_the_model_s(page: Any, explorer: Explorer) -> None:
    """Browser and model move spectra by the same rule: to another wavelength and back."""
    reset(page, explorer)
    press(page, "albedo", "ArrowRight", times=20)
    press(page, "g", "ArrowLeft", times=12)
    press(page, "rho_black", "ArrowRight", times=8)
    press(page, "n", "ArrowRight", times=6)
    before = positions(page)
    start = int(page.get_attribute("#wavelength [role=slider]", "aria-valuenow"))
    press(page, "wavelength", "ArrowLeft", times=9)
    first = explorer.first()
    own, here = explorer.source.spectra[first.material], start - 9
    # the same moves made where they were made, seen from here
    albedo, _, g = (slider.value(before[slider.name]) for slider in SLIDERS[:3])
    expected = [
        pytest.approx(move_share(own.albedo, start, albedo)[here], abs=2e-3),
        pytest.approx(move_cosine(own.g, start, g)[here], abs=6e-3),
    ]

    def values(thumbs: list[tuple[float, float]]) -> list[float]:
        return [SLIDERS[k].value(thumbs[k][0]) for k in (0, 2)]

    found = eventually(page, THUMBS, lambda thumbs: values(thumbs) == expected, NAMES)
    assert values(found) == expected
    asked = {**positions(page), "material": first.material, "wavelength": here, "sample": 0}
    point = pytest.approx(explorer.picture(Settings.of(asked)).point, abs=1e-3)
    assert eventually(page, POINT, lambda found: found == point) == point


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1920, 1080)])
def test_everything_fits_on_the_screen(page: Any, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    wait_until_drawn(page)
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
