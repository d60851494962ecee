"""Make the pictures of the documents again: `python docs/pictures.py [NAME ...]`.

Each entry names the commands; those of reports are taken by a headless browser (Chromium or
Chrome, found on the path), everything else is written by the command itself.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).resolve().parent
IMAGES = DOCS / "images"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@dataclass(frozen=True)
class Picture:
    """How one picture is made.

    Attributes:
        commands: run in one new folder, in order.
        source: the file there: a picture that is copied, or a report that is looked at.
        size: width and height [pixel] of the browser's window, for reports.
        inputs: files of `docs` or named blocks of its pages ("page.md: file.toml") to begin with.
    """

    commands: tuple[str, ...]
    source: str
    size: tuple[int, int] = (1100, 1400)
    inputs: tuple[str, ...] = ()


PICTURES = {
    "report.png": Picture(
        ("benchtwin run default --out report",), "report/report.html", (1100, 1500)
    ),
    "tutorial_first.png": Picture(
        ("benchtwin run first.toml --out first",), "first/report.html", (1100, 1490),
        ("tutorial_first_measurement.md: first.toml",),
    ),
    "tutorial_budget.png": Picture(
        ("benchtwin budget mine --quick --thickness 0.01 --out budget",),
        "budget/budget.html", (1000, 760),
        (
            "tutorial_your_measurement.md: mine/bench.toml",
            "tutorial_your_measurement.md: mine/samples.csv",
            "tutorial_your_measurement.md: mine/relative.csv",
        ),
    ),
    "tutorial_diagnosis.png": Picture(
        (
            "benchtwin simulate visit.toml --out visit",
            "benchtwin diagnose visit/measurement.nc --bench bench.toml --quick --rounds 3"
            " --out gap",
        ),
        "gap/diagnosis.html", (1000, 1290),
        ("tutorial_diagnose.md: visit.toml", "tutorial_diagnose.md: bench.toml"),
    ),
    "tutorial_design.png": Picture(
        ("benchtwin design resin.toml --no-simulate --out study",),
        "study/report.html", (1000, 1340),
        ("tutorial_design.md: resin.toml",),
    ),
    "fluorescence.png": Picture(
        ("benchtwin run l1-s2 --out marker",), "marker/report.html", (1100, 1300)
    ),
    "checker.png": Picture(("benchtwin predict --checker --out checker",), "checker/checker.png"),
}  # fmt: skip


def main(names: list[str]) -> int:
    """Make the named pictures, or say which there are."""
    if not names or not set(names) <= set(PICTURES):
        print("pictures:", ", ".join(PICTURES))
        return 2
    for name in names:
        make(PICTURES[name], IMAGES / name)
    return 0


def make(picture: Picture, target: Path) -> None:
    """Run the commands in a new folder and bring the picture home."""
    with tempfile.TemporaryDirectory() as base:
        folder = Path(base)
        for name in picture.inputs:
            _write(name, folder)
        for command in picture.commands:
            words = command.split()
            program = [sys.executable, "-m", "scenarios.cli", *words[1:]]
            subprocess.run(program, cwd=folder, check=True)
        source = folder / picture.source
        if source.suffix == ".html":
            look(source, target, picture.size)
        else:
            shutil.copy(source, target)


def _write(name: str, folder: Path) -> None:
    """Write a file that a page shows."""
    page, _, file = name.partition(": ")
    text = (DOCS / page).read_text(encoding="utf-8")
    content = text.split(f"\n# {file}\n", 1)[1].split("\n```", 1)[0] + "\n"
    path = folder / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content, encoding="utf-8")


def look(page: Path, target: Path, size: tuple[int, int]) -> None:
    """Take a picture of a page as a browser shows it.

    Raises:
        SystemExit: there is no browser.
    """
    found = [path for path in map(shutil.which, BROWSERS) if path]
    if not found:
        raise SystemExit(f"no browser: one of {', '.join(BROWSERS)} is needed")
    subprocess.run(
        [
            found[0], "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            f"--window-size={size[0]},{size[1]}", f"--screenshot={target}", page.as_uri(),
        ],
        check=True, capture_output=True,
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
