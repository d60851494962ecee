"""Every example of the documents runs: the commands, the Python and the files of each page.

CONTRIBUTING.md, "Examples in documents", says what the comments above the blocks mean.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.__main__ import discover
from tests.docs.pages import ROOT, Block, all_blocks, blocks_of, commands_of, file_of, pages
from tests.docs.running import Follower, is_said, parse_benchtwin
from twin.measurement import read_measurement, relative_intensities

BLOCKS = all_blocks()
TO_FOLLOW = sorted({block.page for block in BLOCKS if block.kind != "file"})
INSTRUMENTS = {"docs/build_29_dollars.md", "docs/build_2000_dollars.md", "docs/instruments.md"}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maps and compiled programs, shared by all pages."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def reader(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> Follower:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BENCHTWIN_CACHE", str(cache))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("COLUMNS", "100")
    return Follower(tmp_path)


@pytest.mark.parametrize("page", TO_FOLLOW)
def test_the_page_can_be_followed(page: str, reader: Follower) -> None:
    if page in INSTRUMENTS:
        for library in ("seabreeze", "adafruit_as7341", "serial", "pyvisa_py", "usb"):
            pytest.importorskip(library, reason=f"{library} is not installed (extra instruments)")
    blocks = [block for block in BLOCKS if block.page == page]
    files = [block for block in blocks if block.kind == "file" and file_of(block)]
    wanted = [block for block in blocks if block.kind != "file" and block.is_run]
    ran = reader.follow(blocks)
    if page in {"docs/build_29_dollars.md", "docs/build_2000_dollars.md"}:
        check_visit(reader.folder, tables=page == "docs/build_29_dollars.md")
    if reader.missing:
        pytest.skip("reference data are not beside the checkout: " + "; ".join(reader.missing))
    assert ran == len(files) + len(wanted)


def check_visit(folder: Path, *, tables: bool) -> None:
    """What a build page leaves is a whole visit through the stand-ins, and its estimate."""
    measurement = read_measurement(folder / "visit" / "measurement.nc")
    assert measurement.provenance.origin == "simulated"
    assert any(note.endswith("(wire)") for note in measurement.provenance.notes)
    assert relative_intensities(measurement).value.shape[:2] == (2, 3)
    for name in ("report.html", "result.csv", "result.nc"):
        assert (folder / "result" / name).stat().st_size > 0
    if tables:
        assert read_measurement(folder / "tables") == measurement


def test_what_is_not_run_says_why() -> None:
    for block in BLOCKS:
        for reason in block.marked("not run"):
            assert len(reason.split()) >= 3, f"{block.place}: {reason}"
        for test in block.marked("run by"):
            text = (ROOT / test).read_text(encoding="utf-8")
            assert Path(block.page).name in text, f"{test} does not speak of {block.place}"


def test_most_examples_are_run() -> None:
    examples = [block for block in BLOCKS if block.kind != "file"]
    followed = [block for block in examples if block.is_run or block.marked("run by")]
    assert len(followed) > 0.6 * len(examples)


def test_every_benchmark_that_a_page_names_exists() -> None:
    known = {*discover(), "--list", "NAME"}
    for page in pages():
        text = page.read_text(encoding="utf-8")
        named = set(re.findall(r"python -m benchmarks\s+([\w-]+)", text))
        assert named <= known, f"{page.name}: {named - known}"


PLANTED = """
# A page

```console
$ benchtwin list estimators
  lut   ...
  crystal-ball
```

<!-- not run: takes hours of two cores -->

    benchtwin list nothing      of this kind
"""


def test_a_page_that_promises_too_much_is_caught(reader: Follower) -> None:
    first, second = blocks_of(PLANTED)
    with pytest.raises(AssertionError, match=r"not said: *crystal-ball"):
        reader.follow([first])
    assert reader.follow([second]) == 0
    assert commands_of(second)[0].words == ["benchtwin", "list", "nothing"]


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("```python\nassert 1 > 2\n```\n", AssertionError),
        ("```python\ndef test_it():\n    raise KeyError\n```\n", KeyError),
        ("```sh\nbenchtwin list nothing\n```\n", AssertionError),
        ("```sh\nmake coffee\n```\n", AssertionError),
        ("<!-- not run: for a good reason -->\n\n```sh\nbenchtwin brew\n```\n", AssertionError),
        ("<!-- run as: benchtwin list lamps -->\n```sh\nbenchtwin run\n```\n", AssertionError),
        ("<!-- not run: so -->\n```python\n1 +\n```\n", SyntaxError),
    ],
)
def test_the_reader_can_fail(text: str, error: type[Exception], reader: Follower) -> None:
    blocks = blocks_of(text)
    assert len(blocks) == 1
    with pytest.raises(error):
        reader.follow(blocks)


def test_an_unknown_marker_is_refused() -> None:
    with pytest.raises(ValueError, match="no marker"):
        blocks_of("<!-- not ran: typed wrongly -->\n```python\n```\n")


def test_an_unknown_option_is_refused() -> None:
    parse_benchtwin(["benchtwin", "run", "quick", "--seed", "3"])
    with pytest.raises(Exception, match="--sead"):
        parse_benchtwin(["benchtwin", "run", "quick", "--sead", "3"])


@pytest.mark.parametrize(
    ("shown", "said", "numbers", "found"),
    [
        ("wavelengths  27", "wavelengths 27", True, True),
        ("wavelengths  27", "wavelengths 28", True, False),
        ("wavelengths  27", "wavelengths 28", False, True),
        ("median 0.8212", "median  0.8230", True, True),
        ("median 0.8212", "median  0.92", True, False),
        ("median 3e-04", "median 0.00031", True, True),
        ("error 0.0003", "error 0.0005", True, True),
        ("albedo ... 0.5", "albedo determined 27 median 0.5", True, True),
        ("median 0.5", "median 0.9 median 0.51", True, True),
        ("0.4 mm", "of 0.4 mm: done in 7 s", True, True),
    ],
)
def test_shown_lines_are_compared(shown: str, said: str, numbers: bool, found: bool) -> None:
    assert is_said(shown, said, numbers=numbers) is found


def test_blocks_know_their_line() -> None:
    page = ROOT / "docs" / "estimators.md"
    blocks = blocks_of(page.read_text(encoding="utf-8"), "docs/estimators.md")
    assert len(blocks) > 1
    for block in blocks:
        assert isinstance(block, Block)
        line = page.read_text(encoding="utf-8").splitlines()[block.line - 1]
        assert line.strip() == block.text.splitlines()[0]
