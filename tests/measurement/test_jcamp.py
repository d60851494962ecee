"""JCAMP-DX: every form of table, and every mistake with its line."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.measurement.visits import answer_of
from twin.errors import InputError
from twin.measurement import read_jcamp

HEAD = """##TITLE= lamp
##JCAMP-DX= 4.24 $$ a comment
##DATA TYPE= UV/VIS SPECTRUM
##XUNITS= NANOMETERS
##YUNITS= COUNTS
##XFACTOR= {x_factor}
##YFACTOR= {y_factor}
##FIRSTX= {first}
##LASTX= {last}
##NPOINTS= {points}
##XYDATA= (X++(Y..Y))
"""
PUBLISHED = [1, 2, 3, 3, 2, 1, 0, -1, -2, -3]
"""The example of McDonald and Wilks 1988, table VII: the same ordinates in every form."""


def spectrum(
    folder: Path, table: str, first: float = 450, last: float = 459, points: int = 10,
    x_factor: float = 1, y_factor: float = 1,
) -> Path:  # fmt: skip
    head = HEAD.format(first=first, last=last, points=points, x_factor=x_factor, y_factor=y_factor)
    path = folder / "spectrum.jdx"
    path.write_text(f"{head}{table}\n##END=\n")
    return path


@pytest.mark.parametrize(
    "table",
    [
        "450 1 2 3 3 2 1 0 -1 -2 -3",
        "450  1  2  3  3  2\n455  1  0 -1 -2 -3",
        "450, 1, 2, 3, 3, 2, 1, 0, -1, -2, -3",
        "450+1+2+3+3+2+1+0-1-2-3",
        "450 1BCCBA@abc",
        "450ABCCBA@abc",
        "450 1JJ%jjjjjj",
        "450 1JT%jX",
        "450A+2CT+2+1@abc",
        "450 1.0E+00 2.0E+00 3.0E+00 3 2 1 0 -10.0E-01 -2 -3",
        "450AJT%j\n454BjW\n459c",
        "450AJT%j\n455BjW\n460c",
    ],
    ids=[
        "FIX", "two lines", "commas", "PAC", "SQZ", "SQZ at the abscissa", "DIF", "DIF with DUP",
        "mixed", "exponents", "checks", "checks at the next abscissa",
    ],
)  # fmt: skip
def test_every_form_gives_the_published_ordinates(table: str, tmp_path: Path) -> None:
    if "460c" in table:  # the check stands alone behind the last point
        table = table.replace("460c", "459c")
    wavelength, value, found = read_jcamp(spectrum(tmp_path, table))
    np.testing.assert_array_equal(value, PUBLISHED)
    np.testing.assert_allclose(wavelength, np.arange(450.0, 460.0), rtol=1e-12)
    assert found.title == "lamp"
    assert found.y_units == "COUNTS"
    assert found.acquisition is None


def squeezed(value: int, positive: str, negative: str) -> str:
    text = str(abs(value))
    letters = positive if value >= 0 else negative
    return letters[int(text[0])] + text[1:]


def encoded(values: list[int], first: int, per_line: int) -> str:
    """Difference form with repetitions, with checks, as instruments write it."""
    lines = []
    for start in range(0, len(values), per_line):
        at = max(start - 1, 0)
        part = values[at : start + per_line]
        steps = list(np.diff(part))
        line = f"{first + at}" + squeezed(part[0], "@ABCDEFGHI", "@abcdefghi")
        for step, group in groupby(steps):
            count = len(list(group))
            line += squeezed(int(step), "%JKLMNOPQR", "%jklmnopqr")
            if count > 1:
                line += squeezed(count, " STUVWXYZs", "")
        lines.append(line)
    lines.append(f"{first + len(values) - 1}" + squeezed(values[-1], "@ABCDEFGHI", "@abcdefghi"))
    return "\n".join(lines)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(
    values=st.lists(st.integers(-99_999, 99_999) | st.integers(-2, 2), min_size=2, max_size=60),
    per_line=st.integers(2, 9),
)
def test_what_is_encoded_comes_back(
    values: list[int], per_line: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("jcamp")
    table = encoded(values, 400, per_line)
    path = spectrum(folder, table, 400, 400 + len(values) - 1, len(values), y_factor=0.25)
    _, value, _ = read_jcamp(path)
    np.testing.assert_array_equal(value, 0.25 * np.array(values))


@pytest.mark.parametrize(
    ("units", "first", "last", "expected"),
    [
        ("1/CM", 25000, 20000, [400, 1e7 / 22500, 500]),
        ("1/CM", 20000, 25000, [400, 1e7 / 22500, 500]),
        ("MICROMETERS", 0.4, 0.5, [400, 450, 500]),
        ("nanometers", 500, 400, [400, 450, 500]),
    ],
)
def test_units_of_the_abscissa(
    units: str, first: float, last: float, expected: list[float], tmp_path: Path
) -> None:
    path = spectrum(tmp_path, f"{first} 7 8 9", first, last, 3)
    path.write_text(path.read_text().replace("NANOMETERS", units))
    wavelength, value, _ = read_jcamp(path)
    np.testing.assert_allclose(wavelength, expected, rtol=1e-12)
    rising = expected[0] == pytest.approx(first * {"MICROMETERS": 1e3}.get(units, 1.0)) or (
        units == "1/CM" and first > last
    )
    np.testing.assert_array_equal(value, [7, 8, 9] if rising else [9, 8, 7])


def test_factors_scale_the_table(tmp_path: Path) -> None:
    path = spectrum(tmp_path, "4500 1 2 3\n4530 3 2 1", 450, 455, 6, x_factor=0.1, y_factor=2.5)
    wavelength, value, _ = read_jcamp(path)
    np.testing.assert_allclose(wavelength, np.arange(450.0, 456.0))
    np.testing.assert_array_equal(value, [2.5, 5.0, 7.5, 7.5, 5.0, 2.5])


SPECTRASUITE = """##TITLE= SPECTRASUITE EXPORTED SPECTRUM
##DATA TYPE= LINK
##BLOCKS= 2
##TITLE= PROCESSED SPECTRUM
##JCAMP-DX= 5 $$EXPORTED SPECTRASUITE FILE
##DATA PROCESSING= DARK:No REFERENCE:Yes
##DATA PROCESSING= BOXCAR:2 ELECTRICAL DARK: false
##.ACQUISITION TIME= 200
##.AVERAGES= 5
##XUNITS= NANOMETERS
##YUNITS= Transmission (%)
##XFACTOR= 1.0
##YFACTOR= 1.0
##FIRSTX= 176,36
##LASTX= 176,80
##FIRSTY= 32,795
##NPOINTS= 3
##XYPOINTS= (XY..XY)
176,36, 32,795
176,58, -1,5
176,80, 0,250
##END=
##TITLE= DARK SPECTRUM
##XUNITS= NANOMETERS
##YUNITS= COUNTS
##NPOINTS= 2
##XYPOINTS= (XY..XY)
176.36, 1479.0; 176.58, 1480.5
##END=
##END=
"""


def test_several_blocks_and_decimal_commas(tmp_path: Path) -> None:
    """The layout in which SpectraSuite exports."""
    path = tmp_path / "s.jdx"
    path.write_text(SPECTRASUITE)
    with pytest.raises(InputError, match=r"2 spectra \(1: PROCESSED SPECTRUM; 2: DARK SPECTRUM\)"):
        read_jcamp(path)
    wavelength, value, found = read_jcamp(path, block=1)
    np.testing.assert_array_equal(wavelength, [176.36, 176.58, 176.80])
    np.testing.assert_array_equal(value, [32.795, -1.5, 0.25])
    assert (found.acquisition, found.averages, found.boxcar) == (200.0, 5, 2)
    wavelength, value, _ = read_jcamp(path, block=2)
    np.testing.assert_array_equal(value, [1479.0, 1480.5])
    with pytest.raises(InputError, match="a number of 1 to 2"):
        read_jcamp(path, block=3)


GOOD = "450AJT%j\n454BjW\n459c"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("##TITLE= lamp", "lamp", "line 1: found 'lamp'; expected ##TITLE="),
        ("454BjW", "454CjW", "line 13: found 3 as the check of 2"),
        ("454BjW", "457BjW", "line 13: found the abscissa 457 at point 5; expected 454"),
        ("454BjW\n", "", "line 13: found -3 as the check of 2"),
        ("454BjW\n459c\n", "", "line 10: found 5 points; expected 10, as ##NPOINTS= says"),
        ("454BjW", "454Bj?", "line 13: found '?'"),
        ("454BjW", "454BjWW", "line 13: found more than 10 points"),
        ("450AJT%j", "450KJT%j", "found the difference K without an ordinate before"),
        ("450AJT%j", "450", "line 13: found the abscissa 454 at point 1"),
        ("##NPOINTS= 10\n", "", "line 1: found no ##NPOINTS="),
        ("##FIRSTX= 450\n", "", "found no ##FIRSTX="),
        ("##NPOINTS= 10", "##NPOINTS= ten", "line 10: found ##NPOINTS= ten"),
        ("##LASTX= 459", "##LASTX= 450", "found 10 points from 450 to 450"),
        ("##YFACTOR= 1", "##YFACTOR= 0", "line 7: found ##YFACTOR= 0"),
        ("##XUNITS= NANOMETERS", "##XUNITS= HZ", "line 4: found ##XUNITS= HZ"),
        ("##XYDATA= (X++(Y..Y))", "##PEAK TABLE= (XY..XY)", "line 11: found a table ##PEAK TABLE="),
        ("##XYDATA= (X++(Y..Y))", "##XYDATA= (XYA)", "a table of the form (XYA)"),
        ("##XYDATA= (X++(Y..Y))", "##NOTE= x", "found no ##XYDATA="),
    ],
)  # fmt: skip
def test_mistakes(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = spectrum(tmp_path, GOOD)
    text = path.read_text()
    assert old in text
    read_jcamp(path)
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_jcamp(path)
    assert message in str(caught.value)
    assert caught.value.file == str(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("##LASTX= 176,80", "##LASTX= 180,80", "line 15: found the abscissa 176.8"),
        ("##FIRSTY= 32,795", "##FIRSTY= 3279,5", "line 19: found the first ordinate 32.795"),
        ("##NPOINTS= 3", "##NPOINTS= 4", "line 17: found 3 points"),
        ("176,58, -1,5", "176,58", "line 20: found '176,58'; expected pairs"),
        ("176,58, -1,5", "176,90, -1,5", "176.8 nm beside 176.9 nm"),
    ],
)
def test_mistakes_in_pairs(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "s.jdx"
    assert old in SPECTRASUITE
    path.write_text(SPECTRASUITE.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_jcamp(path, block=1)
    assert message in str(caught.value)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(data=st.data())
def test_any_bytes(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = spectrum(tmp_path_factory.mktemp("jcamp"), GOOD)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    path.write_bytes(bytes(content))
    answer, error = answer_of(lambda: read_jcamp(path))
    if error is not None:
        assert error.file == str(path)
    else:
        assert answer is not None
        wavelength, value, _ = answer
        assert wavelength.shape == value.shape
        assert np.all(np.diff(wavelength) > 0)
        assert np.isfinite(value).all()
