"""The figures as files: the same bytes again, sizes, wrong input; the published ones."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from scenarios.figures import FIGURES, make_figures
from twin.errors import InputError

DOCS = Path(__file__).resolve().parents[2] / "docs"
LARGEST = 300_000


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("figures")
    told: list[tuple[float, float]] = []
    files = make_figures(out, quick=True, progress=lambda done, total: told.append((done, total)))
    assert {path.name for path in files} == {
        "figures.json",
        *(f"{name}.{kind}" for name in FIGURES for kind in ("svg", "png")),
    }
    assert told[-1][0] == told[-1][1] > 0
    return out


@pytest.mark.parametrize("name", FIGURES)
def test_pictures_are_whole_and_small(quick: Path, name: str):
    svg = (quick / f"{name}.svg").read_bytes()
    assert ElementTree.fromstring(svg).tag.endswith("svg")
    assert b"<dc:date>" not in svg
    assert len(svg) < LARGEST
    png = (quick / f"{name}.png").read_bytes()
    assert png.startswith(b"\x89PNG")
    assert len(png) < LARGEST


def test_same_seed_same_bytes_whatever_the_threads(quick: Path, tmp_path: Path):
    for path in make_figures(tmp_path, ["figure6"], quick=True, threads=1):
        if path.name != "figures.json":
            assert path.read_bytes() == (quick / path.name).read_bytes()
    again = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))
    first = json.loads((quick / "figures.json").read_text(encoding="utf-8"))
    assert again["figure6"] == first["figure6"]
    assert set(again) == {"figure6", "quick", "seed"}


def test_another_seed_gives_other_bytes(quick: Path, tmp_path: Path):
    make_figures(tmp_path, ["figure6"], quick=True, seed=1)
    assert (tmp_path / "figure6.svg").read_bytes() != (quick / "figure6.svg").read_bytes()


def test_coarse_figures_find_the_map_unique(quick: Path):
    found = json.loads((quick / "figures.json").read_text(encoding="utf-8"))
    assert found["figure2"]["uniqueness"]["jacobian_sign"]["other_sign"] == 0
    assert found["figure2"]["coverage"]["share_above_albedo_0.9"] > 0.5
    assert found["figure6"]["beer_largest_deviation_at_albedo_0"] < 1e-6


@pytest.mark.parametrize(
    ("names", "seed", "said"), [(["figure3"], 0, "figure3"), ([], -1, "seed -1")]
)
def test_wrong_input_is_said_and_nothing_is_written(
    tmp_path: Path, names: list[str], seed: int, said: str
):
    out = tmp_path / "new"
    with pytest.raises(InputError, match=said):
        make_figures(out, names, quick=True, seed=seed)
    assert not out.exists()


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path):
    path = tmp_path / "file"
    path.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="output folder"):
        make_figures(path, ["figure6"], quick=True)


def test_published_figures_are_full_small_and_shown():
    page = (DOCS / "figures.md").read_text(encoding="utf-8")
    found = json.loads((DOCS / "images" / "figures.json").read_text(encoding="utf-8"))
    assert found["quick"] is False
    assert set(FIGURES) <= set(found)
    for name in FIGURES:
        assert f"images/{name}." in page
        for kind in ("svg", "png"):
            assert (DOCS / "images" / f"{name}.{kind}").stat().st_size < LARGEST


def numbers(value: object) -> set[str]:
    """Every number of a JSON value, to three significant digits."""
    if isinstance(value, dict):
        return set().union(*map(numbers, value.values()))
    return {f"{value:.3g}"} if isinstance(value, (int, float)) else set()


def quoted(page: str) -> list[str]:
    """The numbers that a page quotes from figures.json: those in bold, percentages as shares."""
    found = re.findall(r"\*\*(-?[\d.]+(?:e-?\d+)?)( %)?\*\*", page)
    return [f"{float(number) * (0.01 if percent else 1.0):.3g}" for number, percent in found]


def test_the_page_quotes_what_was_computed():
    page = (DOCS / "figures.md").read_text(encoding="utf-8")
    found = numbers(json.loads((DOCS / "images" / "figures.json").read_text(encoding="utf-8")))
    said = quoted(page)
    assert len(said) > 20
    assert [number for number in said if number not in found] == []
    assert "0.123" not in found, "the control: not every number is in there"


def test_the_command_makes_what_it_names(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from scenarios.cli import app

    runner = CliRunner()
    refused = runner.invoke(app, ["figures", str(tmp_path), "figure3", "--quick"])
    assert refused.exit_code == 2
    assert "figure3" in refused.output
    made = runner.invoke(app, ["figures", str(tmp_path), "figure6", "--quick", "--json"])
    assert made.exit_code == 0
    names = {Path(name).name for name in json.loads(made.stdout)["files"]}
    assert names == {"figure6.svg", "figure6.png", "figures.json"}
