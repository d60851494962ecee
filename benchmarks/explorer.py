"""From a slider to the picture on the page of `benchtwin explore`, in a headless browser.

The page's own process serves it, as for a person. The clock is the browser's: from the time stamp
of the key press that moves a slider to the task after the animation frame that follows the last
figure's `plotly_afterplot`. Captures, map, colours and uncertainty are all computed anew for every
move. Chromium has no graphics card here and draws with the processor.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from statistics import median
from typing import Any

from twin.errors import InputError

SLIDERS = (
    "albedo", "sigma_t_per_mm", "g", "thickness_mm", "n", "rho_black", "rho_white",
    "acceptance_deg", "averages", "wavelength",
)  # fmt: skip
FIGURES = ("spectra",)
"""Drawn after the others and at every move; what a move leaves as it is, is not drawn again."""
WATCH = """figures => {
  document.addEventListener('keydown', event => {
    if (window.moves) { window.moves.start = event.timeStamp; }
  }, true);
  figures.forEach(name => document.querySelector('#' + name + ' .js-plotly-plot')
    .on('plotly_afterplot', () => {
      const mine = window.moves;
      if (!mine || mine.start === null) { return; }
      mine.left -= 1;
      if (mine.left === 0) {
        const painted = () => { mine.done(performance.now() - mine.start); };
        requestAnimationFrame(() => setTimeout(painted, 0));
      }
    }));
}"""
ARM = """count => {
  window.moves = {start: null, left: count};
  window.painted = new Promise(done => { window.moves.done = done; });
}"""
DRAWN = """() => document.querySelector('#tile-albedo') !== null
  && [...document.querySelectorAll('.dash-graph')].filter(place => place.offsetParent !== null)
    .every(place => {
      const graph = place.querySelector('.js-plotly-plot');
      return graph !== null && graph.querySelector('.main-svg') !== null
        && Math.abs(graph._fullLayout.width - place.clientWidth) <= 1
        && Math.abs(graph._fullLayout.height - place.clientHeight) <= 1;
    })"""
TRIES = ("chromium", "chromium-browser", "google-chrome", "chrome")
COMMAND = "from scenarios.cli import main; main()"


def chromium() -> str | None:
    """The path of an installed Chromium, or None."""
    return next((found for name in TRIES if (found := shutil.which(name))), None)


@contextlib.contextmanager
def browser() -> Iterator[Any]:
    """A headless Chromium, which ends with the block.

    Raises:
        InputError: there is none on this machine.
    """
    from playwright.sync_api import sync_playwright

    path = chromium()
    if path is None:
        raise InputError("no Chromium", f"one of {', '.join(TRIES)} on the path")
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield opened
        finally:
            opened.close()


@contextlib.contextmanager
def served(*arguments: str) -> Iterator[str]:
    """The page of `benchtwin explore`, served by a process of its own; yields its address.

    Raises:
        InputError: it did not come up.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"http://127.0.0.1:{port}/"
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, "explore", *arguments, "--no-browser", "--port", str(port)],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=dict(os.environ),
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 300.0
        while time.monotonic() < deadline and process.poll() is None:
            with contextlib.suppress(OSError), urllib.request.urlopen(address, timeout=5):
                break
            time.sleep(0.2)
        else:
            process.terminate()
            said = process.communicate(timeout=30)[1].strip()
            raise InputError(f"no page ({said})", "the page of benchtwin explore")
        yield address
    finally:
        process.terminate()
        process.communicate(timeout=30)


def wait_until_drawn(page: Any) -> None:
    """Wait for the page's numbers, and until every figure that shows has the size of its place."""
    page.wait_for_function(DRAWN)


def moved(page: Any, name: str, key: str) -> float:
    """Press a key on a slider; milliseconds until the picture is painted."""
    page.focus(f"#{name} [role=slider]")
    page.evaluate(ARM, len(FIGURES))
    page.keyboard.press(key)
    return float(page.evaluate("window.painted"))


def run(quick: bool) -> dict[str, Any]:
    """Move every slider of the default scenario to and fro.

    Args:
        quick: one round of ten moves in place of six.

    Returns:
        `explorer_ms`, the median over all moves, with its spread, and the median by slider.
    """
    by_slider: dict[str, list[float]] = {name: [] for name in SLIDERS}
    with served() as address, browser() as opened:
        page = opened.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        wait_until_drawn(page)
        page.evaluate(WATCH, list(FIGURES))
        for turn in range(1 if quick else 6):
            for name in SLIDERS:
                # three steps up before the first step back: no position is seen twice at once
                by_slider[name].append(
                    moved(page, name, "ArrowLeft" if turn % 4 == 3 else "ArrowRight")
                )
        rate = dragged(page)
    every = sorted(value for values in by_slider.values() for value in values)
    return {
        "explorer_ms": median(every),
        "moves": len(every),
        "worst_ms": every[-1],
        "ninety_ms": every[int(0.9 * (len(every) - 1))],
        "pictures_per_s": rate,
        "load": os.getloadavg()[0],
        "by_slider_ms": {name: median(values) for name, values in by_slider.items()},
    }


def dragged(page: Any, seconds: float = 2.0) -> float:
    """Drag a slider to and fro; pictures per second meanwhile."""
    page.evaluate(
        "window.seen = 0; document.querySelector('#spectra .js-plotly-plot')"
        ".on('plotly_afterplot', () => { window.seen += 1; })"
    )
    thumb = page.locator("#sigma_t_per_mm [role=slider]").bounding_box()
    x, y = thumb["x"] + thumb["width"] / 2, thumb["y"] + thumb["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    started, step = time.monotonic(), 0
    while time.monotonic() - started < seconds:
        page.mouse.move(x - 40 + abs(step % 160 - 80), y)
        page.wait_for_timeout(16)
        step += 1
    page.mouse.up()
    return float(page.evaluate("window.seen")) / (time.monotonic() - started)


def screenshot(
    file: str, *arguments: str, tab: str = "", size: tuple[int, int] = (1280, 800)
) -> None:
    """A picture of the page, as the documentation shows it.

    Args:
        file: PNG to write.
        *arguments: of `benchtwin explore`.
        tab: title of the tab; "" takes the first.
        size: width and height of the window [pixel].
    """
    with served(*arguments) as address, browser() as opened:
        page = opened.new_page(viewport={"width": size[0], "height": size[1]})
        page.goto(address)
        wait_until_drawn(page)
        if tab:
            page.click(f"#tabs label:has-text('{tab}')")
            wait_until_drawn(page)
        page.screenshot(path=file)
