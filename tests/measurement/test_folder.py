"""The folder a person makes: the documented examples, and every mistake the issue names."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.measurement.visits import answer_of
from twin.errors import InputError
from twin.measurement import (
    measured_black_reflectance,
    read_measurement,
    relative_intensities,
    write_measurement,
)
from twin.measurement.folder import CAPTURE_COLUMNS, RELATIVE_COLUMNS, SAMPLE_COLUMNS

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs" / "examples"


@pytest.fixture
def counts(tmp_path: Path) -> Path:
    return Path(shutil.copytree(EXAMPLES / "hand_made", tmp_path / "counts"))


@pytest.fixture
def ready(tmp_path: Path) -> Path:
    return Path(shutil.copytree(EXAMPLES / "hand_made_relative", tmp_path / "ready"))


def test_example_of_counts(tmp_path: Path) -> None:
    measurement = read_measurement(EXAMPLES / "hand_made")
    assert measurement.captures is not None
    assert measurement.captures.counts.shape == (22, 16)
    assert [sample.thickness_mm for sample in measurement.samples] == [0.5, 1.0]
    assert measurement.provenance.origin == "handmade"
    assert measurement.bench.instrument.wavelength_nm == tuple(range(400, 701, 20))
    result = relative_intensities(measurement)
    assert result.valid.all()
    assert result.repeats == 2
    assert np.all((result.value > 0.0) & (result.value < 1.0))
    assert np.all((result.sigma > 0) & (result.sigma < 0.01))
    assert any("scatter of repeats" in reason for reason in result.reasons)
    black = measured_black_reflectance(measurement)
    assert black is not None
    assert np.all((black.value > 0.0) & (black.value < 0.2))
    assert read_measurement(write_measurement(measurement, tmp_path / "x.nc")) == measurement


def test_example_of_relative_intensities(tmp_path: Path) -> None:
    measurement = read_measurement(EXAMPLES / "hand_made_relative")
    assert measurement.relative is not None
    result = relative_intensities(measurement)
    assert result.value.shape == (2, 3, 16)
    first = (
        (EXAMPLES / "hand_made_relative" / "relative.csv").read_text().splitlines()[1].split(",")
    )
    assert result.value[0, 0, 0] == float(first[4])
    assert result.sigma[0, 0, 0] == pytest.approx(float(first[5]))
    assert read_measurement(write_measurement(measurement, tmp_path / "x.nc")) == measurement


def test_every_column_is_documented() -> None:
    text = (ROOT / "docs" / "measurement.md").read_text()
    for columns in (SAMPLE_COLUMNS, CAPTURE_COLUMNS, RELATIVE_COLUMNS):
        for column in columns:
            assert re.search(rf"^\| `{column.name}` \|", text, re.MULTILINE), column.name


def _edit(path: Path, change: Callable[[str], str]) -> None:
    old = path.read_text()
    new = change(old)
    assert new != old
    path.write_text(new)


def _line(number: int, change: Callable[[str], str]) -> Callable[[str], str]:
    def edit(text: str) -> str:
        lines = text.split("\n")
        lines[number - 1] = change(lines[number - 1])
        return "\n".join(lines)

    return edit


def _without(pattern: str) -> Callable[[str], str]:
    return lambda text: "".join(
        line for line in text.splitlines(keepends=True) if not re.search(pattern, line)
    )


def _cell(number: int, column: int, value: str) -> Callable[[str], str]:
    def change(line: str) -> str:
        cells = line.split(",")
        cells[column] = value
        return ",".join(cells)

    return _line(number, change)


def _swap(text: str) -> str:
    lines = text.split("\n")
    lines[3], lines[4] = lines[4], lines[3]
    return "\n".join(lines)


def _all_counts(pattern: str, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        lines = text.split("\n")
        for index, line in enumerate(lines):
            if re.search(pattern, line):
                cells = line.split(",")
                cells[4] = value
                lines[index] = ",".join(cells)
        return "\n".join(lines)

    return change


# file, what is done to it, what the message says (place first)
MISTAKES: dict[str, tuple[str, Callable[[str], str], tuple[str, ...]]] = {
    "misspelt column": (
        "captures.csv",
        lambda t: t.replace("wavelength_nm", "wavelenght_nm"),
        ("line 1, column 4", "'wavelenght_nm'", "Did you mean `wavelength_nm`?"),
    ),
    "missing column": (
        "samples.csv",
        lambda t: (
            t.replace(",1.5", "")
            .replace(",n", "")
            .replace(",thickness_mm", "")
            .replace(",0.5", "")
            .replace(",1.0", "")
        ),
        ("line 1", "no column 'thickness_mm'"),
    ),
    "column twice": (
        "captures.csv",
        lambda t: t.replace("averages", "counts"),
        ("line 1, column 7", "'counts' twice"),
    ),
    "misspelt key": (
        "bench.toml",
        lambda t: t.replace("gap_mm", "gapp_mm"),
        ("background.gapp_mm", "unknown key", "Did you mean `gap_mm`?"),
    ),
    "negative gap": (
        "bench.toml",
        lambda t: t.replace("gap_mm = 0.5", "gap_mm = -0.5"),
        ("background.gap_mm", "found -0.5", "greater than or equal to 0"),
    ),
    "not TOML": ("bench.toml", lambda t: t.replace("[background]", "[background"), ("line 5",)),
    "NaN in TOML": (
        "bench.toml",
        lambda t: t.replace("gap_mm = 0.5", "gap_mm = nan"),
        ("background.gap_mm", "found nan", "finite number"),
    ),
    "negative thickness": (
        "samples.csv",
        _cell(2, 1, "-0.5"),
        ("line 2, column thickness_mm", "found -0.5", "above 0"),
    ),
    "refractive index": ("samples.csv", _cell(3, 2, "0.5"), ("line 3, column n", "1 to 5")),
    "unknown glass": ("samples.csv", _cell(3, 2, "unobtainium"), ("line 3, column n", "unobt")),
    "sample twice": (
        "samples.csv",
        lambda t: t.replace("teal-thick", "teal-thin"),
        ("line 3, column name", "'teal-thin' twice"),
    ),
    "decreasing wavelengths": (
        "captures.csv",
        _swap,
        ("line 5, column wavelength_nm", "440 nm after 460 nm", "increase"),
    ),
    "wavelengths differ": (
        "captures.csv",
        _cell(25, 3, "541"),
        ("line 18", "dark of the visit"),
    ),
    "wavelengths do not overlap": (
        "captures.csv",
        lambda t: "".join(
            re.sub(r",(\d)(\d0),", r",1\1\2,", line) if line.startswith("beam") else line
            for line in t.splitlines(keepends=True)
        ),
        ("beam_reference of the visit", "do not overlap"),
    ),
    "wavelengths in micrometres": (
        "captures.csv",
        lambda t: re.sub(r",(\d)(\d0),", r",0.\1\2,", t),
        ("0.4 nm", "nanometres"),
    ),
    "NaN": ("captures.csv", _cell(7, 4, "NaN"), ("line 7, column counts", "'NaN'", "a number")),
    "error cell": ("captures.csv", _cell(7, 4, "#DIV/0!"), ("line 7, column counts", "#DIV/0!")),
    "empty cell": ("captures.csv", _cell(7, 4, ""), ("line 7, column counts", "an empty cell")),
    "infinite": ("captures.csv", _cell(7, 4, "1e999"), ("line 7, column counts", "finite")),
    "negative time": ("captures.csv", _cell(2, 5, "-0.1"), ("line 2", "integration_s -0.1")),
    "no averages": ("captures.csv", _cell(2, 6, "0"), ("line 2", "averages 0")),
    "averages change": ("captures.csv", _cell(3, 6, "11"), ("line 3", "settings", "line 2")),
    "zero white": (
        "captures.csv",
        _all_counts("^white_reference", "0"),
        ("white_reference of the visit that is zero",),
    ),
    "dark white": (
        "captures.csv",
        _all_counts("^white_reference", "2398"),
        ("white_reference of the visit not clearly above its dark",),
    ),
    "saturated capture": (
        "captures.csv",
        _all_counts("^white,teal-thin", "65535"),
        ("white of 'teal-thin' saturated at every wavelength", "shorter integration time"),
    ),
    "sample without its reference": (
        "captures.csv",
        _without("^white_reference"),
        ("no white_reference for black of 'teal-thin'",),
    ),
    "no dark at that time": (
        "captures.csv",
        _without("^dark.*,0.5,"),
        ("no dark for collimated of 'teal-thin' (0.5 s)",),
    ),
    "sample not captured": (
        "captures.csv",
        _without("teal-thick"),
        ("sample 'teal-thick'", "no capture 'black'"),
    ),
    "unknown capture": (
        "captures.csv",
        lambda t: t.replace("white_reference", "white_referense"),
        ("line 34, column capture", "'white_referense'", "Did you mean `white_reference`?"),
    ),
    "unknown sample": (
        "captures.csv",
        lambda t: t.replace("teal-thin", "teal-thinn", 1),
        ("column sample", "'teal-thinn'", "Did you mean `teal-thin`?"),
    ),
    "capture without sample": (
        "captures.csv",
        lambda t: t.replace("black,teal-thin,", "black,,", 1),
        ("without a sample",),
    ),
    "duplicate row": (
        "captures.csv",
        _line(5, lambda line: line + "\n" + line),
        ("line 6, column wavelength_nm", "460 nm a second time"),
    ),
    "duplicate shot": (
        "captures.csv",
        lambda t: t + "\n".join(t.split("\n")[1:17]),
        ("line 354", "400 nm a second time", "column repeat"),
    ),
    "truncated between rows": (
        "captures.csv",
        lambda t: "\n".join(t.split("\n")[:-5]),
        ("12 wavelengths", "truncated"),
    ),
    "truncated within a row": ("captures.csv", lambda t: t[:-20], ("line 353", "truncated")),
    "no rows": ("captures.csv", lambda t: t.split("\n")[0], ("without rows",)),
    "empty file": ("captures.csv", lambda t: "", ("an empty file",)),
    "decimal commas": (
        "captures.csv",
        lambda t: "\n".join(line.replace(",", ";").replace(".", ",") for line in t.split("\n")),
        ("line 2, column counts", "'2397,3'", "decimal point"),
    ),
    "decimal commas between commas": (
        "captures.csv",
        lambda t: t.replace("2397.3", "2397,3"),
        ("line 2", "9 cells", "decimal comma"),
    ),
    "open quotes": ("captures.csv", lambda t: t + '"', ("line 354",)),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes(name: str, counts: Path) -> None:
    file, change, expected = MISTAKES[name]
    _edit(counts / file, change)
    with pytest.raises(InputError) as caught:
        read_measurement(counts)
    message = str(caught.value)
    assert message.startswith(str(counts / file)), message
    for part in expected:
        assert part in message, message
    assert "\n" not in message


RELATIVE_MISTAKES: dict[str, tuple[Callable[[str], str], tuple[str, ...]]] = {
    "zero sigma": (_cell(4, 5, "0"), ("line 4, column sigma", "above 0")),
    "sigma left out": (lambda t: re.sub(r",[^,\n]*$", ",", t), ("without sigma",)),
    "per cent": (
        lambda t: re.sub(r",0\.(\d\d)(\d+),0", r",\1.\2,0", t),
        ("line 2, column value", "per cent"),
    ),
    "a reference": (
        lambda t: t.replace("black", "black_reference"),
        ("line 2, column capture", "one of black, white, collimated"),
    ),
    "capture missing": (_without("^collimated,teal-thin"), ("no capture 'collimated'",)),
    "duplicate": (_line(4, lambda x: x + "\n" + x), ("line 5, column wavelength_nm", "second")),
}


@pytest.mark.parametrize("name", RELATIVE_MISTAKES)
def test_relative_mistakes(name: str, ready: Path) -> None:
    change, expected = RELATIVE_MISTAKES[name]
    if name == "sigma left out":
        text = (ready / "relative.csv").read_text()
        (ready / "relative.csv").write_text(
            "\n".join(line.rpartition(",")[0] for line in text.splitlines())
        )
    else:
        _edit(ready / "relative.csv", change)
    with pytest.raises(InputError) as caught:
        read_measurement(ready)
    message = str(caught.value)
    assert message.startswith(str(ready / "relative.csv")), message
    for part in expected:
        assert part in message, message


def test_files_missing_or_misnamed(counts: Path) -> None:
    (counts / "samples.csv").rename(counts / "sample.csv")
    with pytest.raises(InputError, match=r"no samples.csv.*Did you mean `sample.csv`"):
        read_measurement(counts)
    (counts / "sample.csv").rename(counts / "samples.csv")
    (counts / "captures.csv").rename(counts / "capture.csv")
    with pytest.raises(InputError, match=r"no captures.csv.*Did you mean `capture.csv`"):
        read_measurement(counts)
    (counts / "capture.csv").rename(counts / "captures.csv")
    shutil.copy(counts / "captures.csv", counts / "relative.csv")
    with pytest.raises(InputError, match="one of them"):
        read_measurement(counts)
    (counts / "relative.csv").unlink()
    (counts / "bench.toml").rename(counts / "bank.toml")
    with pytest.raises(InputError, match=r"bank.toml"):
        read_measurement(counts)


def test_bench_may_be_missing(counts: Path) -> None:
    (counts / "bench.toml").unlink()
    assert read_measurement(counts).bench.detector.acceptance_deg == 1.0


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("head", ["", "\ufeff", "sep=X\n"])
def test_what_spreadsheets_write(separator: str, head: str, counts: Path) -> None:
    """Byte-order mark, other separators, CRLF, quotes, padding rows and cells."""
    plain = read_measurement(counts)
    path = counts / "captures.csv"
    lines = [
        separator.join([f'"{line.split(",")[0]}"', *line.split(",")[1:], ""])
        for line in path.read_text().splitlines()
    ]
    text = head.replace("X", separator) + "\r\n".join([*lines, separator * 8, ""])
    path.write_bytes(text.encode())
    assert read_measurement(counts) == plain


def test_rows_of_several_shots_may_be_mixed(counts: Path) -> None:
    path = counts / "captures.csv"
    plain = read_measurement(counts)
    head, *rows = path.read_text().splitlines()
    by_wavelength = sorted(rows, key=lambda row: float(row.split(",")[3]))  # a stable sort
    path.write_text("\n".join([head, *by_wavelength]))
    assert read_measurement(counts) == plain


def test_described_instrument(counts: Path) -> None:
    """With an [instrument] the noise is that of its description, and the grid is checked."""
    toml = counts / "bench.toml"
    plain = toml.read_text()
    toml.write_text(plain + "\n[instrument]\nadc_bits = 12\ndark_level_counts = 2000.0\n")
    result = relative_intensities(read_measurement(counts))  # full scale is 4095
    assert result.valid.any()
    assert not result.valid.all()
    assert any("white_reference of the visit saturated" in reason for reason in result.reasons)
    toml.write_text(plain + '\n[instrument]\nkind = "spectrometer"\n')
    measurement = read_measurement(counts)
    assert measurement.provenance.noise == "instrument"
    assert "description" in relative_intensities(measurement).reasons[0]
    toml.write_text(plain + "\n[instrument]\nstart_nm = 380.0\nstep_nm = 5.0\n")
    with pytest.raises(InputError, match=r"those of the instrument in bench\.toml"):
        read_measurement(counts)
    toml.write_text(plain + "\n[instrument]\nadc_bitts = 12\n")
    with pytest.raises(InputError, match=r"instrument.adc_bitts.*Did you mean `adc_bits`"):
        read_measurement(counts)
    toml.write_text(plain + '\n[instrument]\nkind = "camera"\n')
    with pytest.raises(InputError, match="instrument: found"):
        read_measurement(counts)


def test_saturated_pixels_are_masked(counts: Path) -> None:
    _edit(counts / "captures.csv", _all_counts("^white,teal-thin,0,560", "65535"))
    result = relative_intensities(read_measurement(counts))
    assert (~result.valid).sum() == 1
    assert "1 of 16 pixels masked: white of 'teal-thin' saturated" in result.reasons


def test_not_utf8(counts: Path) -> None:
    path = counts / "captures.csv"
    plain = path.read_text()
    path.write_bytes(plain.encode("utf-16"))
    with pytest.raises(InputError, match="UTF-16"):
        read_measurement(counts)
    path.write_bytes(plain.replace("teal-thin", "t\u00fcrkis").encode("latin-1"))
    with pytest.raises(InputError, match=r"line \d+: found byte 0xfc"):
        read_measurement(counts)


SPECTRA_OF_THE_BENCH = {
    "background.white.reflectance: found 0; expected": ("reflectance = 0.99", "reflectance = 0.0"),
    "background.white.reflectance: found 99; expected": ("reflectance = 0.99", "reflectance = 99"),
    "background.white.reflectance: found the reflectance 'spectralo'": (
        "reflectance = 0.99", 'reflectance = "spectralo"',
    ),
    "panel_spectrum: found the lamp 'led_cold_white'": ("led_cool_white", "led_cold_white"),
}  # fmt: skip


@pytest.mark.parametrize("said", SPECTRA_OF_THE_BENCH)
def test_spectra_of_the_bench(said: str, counts: Path) -> None:
    _edit(counts / "bench.toml", lambda text: text.replace(*SPECTRA_OF_THE_BENCH[said]))
    with pytest.raises(InputError, match=re.escape(f"bench.toml: {said}")):
        read_measurement(counts)


def test_an_unknown_true_material(counts: Path) -> None:
    (counts / "samples.csv").write_text(
        "name,thickness_mm,n,material\nteal-thin,0.5,1.5,demo_inc\nteal-thick,1,1.5,demo_ink\n"
    )
    with pytest.raises(InputError, match=r"line 2, column material: .*demo_ink"):
        read_measurement(counts)


def test_the_folder_of_a_simulated_visit_says_which_file_to_name(tmp_path: Path) -> None:
    (tmp_path / "measurement.nc").write_bytes(b"")
    with pytest.raises(InputError, match=r"name .*measurement\.nc"):
        read_measurement(tmp_path)


@pytest.mark.parametrize("name", ["bench.toml", "samples.csv", "captures.csv", "relative.csv"])
@given(data=st.data())
def test_any_bytes(
    name: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """A result or the clear error, for random bytes and for damaged files."""
    folder = tmp_path_factory.mktemp("any")
    example = "hand_made_relative" if name == "relative.csv" else "hand_made"
    for file in (EXAMPLES / example).iterdir():
        shutil.copy(file, folder / file.name)
    path = folder / name
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        content = bytearray(data.draw(st.binary(max_size=200)))
    else:
        for _ in range(data.draw(st.integers(1, 4))):
            place = data.draw(st.integers(0, len(content) - 1))
            content[place : place + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    path.write_bytes(bytes(content))
    measurement, error = answer_of(lambda: read_measurement(folder))
    if error is None:
        assert measurement is not None
        assert measurement.samples
    else:
        assert error.file.startswith(str(folder))
        assert error.found
        assert error.expected
