"""Files of the inverse adding-doubling community: what is read, masked and refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.errors import InputError
from twin.measurement.rxt import parse_rxt, read_rxt

HEAD = b"IAD1 1.34 1.5 1 1 5 .96 1 203.2 25.4 12.7 1 .96 203.2 25.4 0 1 .95 "
NO_SPHERES = b"IAD1\n1.4\n1.5\n1\n1\n0.1\n1\n0\n"

REAL = {
    "AMC": (301, ("M_R", "M_T", "M_U"), 1, 1.34, 1.5),
    "il_A": (10, ("M_R", "M_T", "M_U"), 1, 1.33, 1.507),
    "il_B": (24, ("M_R", "M_T", "M_U"), 1, 1.33, 1.507),
    "ink_A": (6, ("M_R", "M_T", "M_U"), 1, 1.33, 1.507),
    "ink_B": (15, ("M_R", "M_T", "M_U"), 1, 1.33, 1.507),
    "phantom_with_no_slides": (111, ("M_R", "M_T"), 1, 1.41832, 1.0),
    "tio2_vis": (481, ("M_R", "M_T"), 1, 1.34, 1.45),
    "vio_A": (201, ("M_R", "M_T"), 1, 1.468, 1.0),
}


@pytest.mark.parametrize("name", REAL)
def test_real_files(name: str, shared_data: Path) -> None:
    rows, measured, spheres, n, slide_n = REAL[name]
    visit = read_rxt(shared_data / "translucent" / "iad_rxt" / f"{name}.rxt")
    assert (visit.rows, visit.measured, visit.spheres) == (rows, measured, spheres)
    assert visit.n[0] == n
    assert visit.slide_n[0] == slide_n
    assert visit.valid[:, : len(measured)].all()
    assert not visit.reasons
    assert visit.reflection_sphere is not None


def test_what_the_newer_columns_say(shared_data: Path) -> None:
    folder = shared_data / "translucent" / "iad_rxt"
    phantom = read_rxt(folder / "phantom_with_no_slides.rxt")
    assert phantom.wavelength_nm[[0, -1]].tolist() == [1500.0, 400.0]
    assert phantom.value[0, :2].tolist() == [0.2995, 0.35218]
    assert phantom.n[-1] == 1.44785
    assert phantom.slide_thickness_mm[0] == 0.0
    assert phantom.thickness_mm[0] == 2.65
    assert any("iad -X -i 8 -g 0.9" in comment for comment in phantom.comments)
    titania = read_rxt(folder / "tio2_vis.rxt")
    assert titania.standard_r[0] == 0.992
    assert titania.standard_t[-1] == 0.99048
    assert titania.wavelength_nm[-1] == 880.0  # rows behind # are not read


def test_everything_on_one_line() -> None:
    visit = parse_rxt(HEAD + b"2 0.168 0.249 0.162 0.264")
    assert visit.value[:, :2].tolist() == [[0.168, 0.249], [0.162, 0.264]]
    assert np.isnan(visit.wavelength_nm).all()
    assert np.isnan(visit.value[:, 2]).all()
    assert visit.wall_r.tolist() == [0.96, 0.96]
    assert visit.wall_t.tolist() == [0.95, 0.95]
    assert visit.transmission_sphere is not None
    assert visit.transmission_sphere.third_share == 0.0


def test_counted_readings_with_and_without_wavelength() -> None:
    waved = parse_rxt(HEAD + b"5\n650 .3 .2 .01 .97 .96\n651 .31 .21 .02 .971 .961\r\n")
    assert waved.wavelength_nm.tolist() == [650.0, 651.0]
    assert waved.wall_r.tolist() == [0.97, 0.971]
    assert waved.wall_t.tolist() == [0.96, 0.961]
    assert waved.row_line.tolist() == [2, 3]
    plain = parse_rxt(HEAD + b"1 # one reading\n.3\n\n.4 # second\n")
    assert plain.value[:, 0].tolist() == [0.3, 0.4]
    assert plain.measured == ("M_R",)


def test_every_column_of_letters_lands_where_it_belongs() -> None:
    letters = b"\n L r t u n N d D B R T w W g i c C S F\n"
    row = b"500 .3 .2 .01 1.36 1.45 2 .5 4 .97 .99 .95 .94 .8 8 .5 .25 2 1.5\n"
    visit = parse_rxt(HEAD + letters + row)
    found = [
        visit.n, visit.slide_n, visit.thickness_mm, visit.slide_thickness_mm, visit.beam_mm,
        visit.standard_r, visit.standard_t, visit.wall_r, visit.wall_t, visit.g,
    ]  # fmt: skip
    assert [float(v[0]) for v in found] == [1.36, 1.45, 2, 0.5, 4, 0.97, 0.99, 0.95, 0.94, 0.8]
    assert (visit.incidence_deg, visit.unscattered_in_r, visit.unscattered_in_t) == (8, 0.5, 0.25)
    assert visit.spheres == 2
    assert any("column F" in reason for reason in visit.reasons)


def test_without_spheres_their_description_may_be_missing() -> None:
    short = parse_rxt(NO_SPHERES + b"2\n.3 .4\n")
    assert short.spheres == 0
    assert short.reflection_sphere is None
    long = parse_rxt(NO_SPHERES + b"100 20 10 1 .96 100 20 10 1 .96\n r t\n.3 .4\n")
    assert long.spheres == 0
    assert long.value[0, 1] == 0.4
    lettered = parse_rxt(NO_SPHERES + b" r t\n.3 .4\n")
    assert lettered.measured == ("M_R", "M_T")


def test_no_slide_is_said_in_three_ways() -> None:
    for slide in (b"1.5 1 0", b"1 1 1", b"0 1 1"):
        n_slide, thickness, width = slide.split()
        raw = b"IAD1 1.4 %b %b %b 1 1 0 2\n.3 .4\n" % (n_slide, thickness, width)
        visit = parse_rxt(raw)
        assert visit.slide_n[0] == 1.0
        assert visit.slide_thickness_mm[0] == 0.0


def test_impossible_readings_are_masked_and_counted() -> None:
    visit = parse_rxt(HEAD + b"\nr t\n.3 .4\n-.01 .4\n1.2 .4\nnan .4\n1.3 -.1\n")
    assert visit.valid[:, 0].tolist() == [True, False, False, False, False]
    assert visit.valid[:, 1].tolist() == [True, True, True, True, False]
    assert np.isnan(visit.value[~visit.valid]).all()
    assert visit.reasons == (
        "M_R: 1 not a number, masked (first in line 6)",
        "M_R: 1 below 0, masked (first in line 4)",
        "M_R: 2 above 1, masked (first in line 5)",
        "M_T: 1 below 0, masked (first in line 7)",
    )


@pytest.mark.parametrize(
    ("raw", "place", "found"),
    [
        (b"", "line 1", "''"),
        (b"iad1 1.4", "line 1", "iad1 1.4"),
        (b"IAD1\n1.4\n1.5\n", "line 4", "end of the file"),
        (b"IAD1\n1,4\n", "line 2", "1,4"),
        (b"IAD1\n0.9\n", "line 2", "0.9"),
        (b"IAD1\n1e999\n", "line 2", "1e999"),
        (b"IAD1\n1.4\n1.5\nnan\n", "line 4", "nan"),
        (b"IAD1 1.4 1.5 1 1 1 1 1.5", "line 1", "1.5 spheres"),
        (b"IAD1 1.4 1.5 1 1 1 1 1\n100 120 1 1 .9", "line 2", "120"),
        (HEAD, "line 1", "end of the file"),
        (HEAD + b"8\n.3 .4", "line 1", "8"),
        (HEAD + b"\nr t z\n.3 .4 .5", "line 2", "'z'"),
        (HEAD + b"\nr r\n.3 .4", "line 2", "twice"),
        (HEAD + b"\nL n\n500 1.4", "line 2", "Ln"),
        (HEAD + b"\nr t\n", "line 3", "no rows"),
        (HEAD + b"\nr t\n.3 .4\n.3\n", "line 4", "1 numbers"),
        (HEAD + b"\nr t\n.3 x\n", "line 3", "'x'"),
        (HEAD + b"\nr t n\n.3 .4 .9\n", "line 3", "0.9 in column n"),
        (HEAD + b"\nr t i\n.3 .4 8\n.3 .4 9\n", "line 4", "9 in column i"),
        (HEAD + b"2\n500 .3 .4\n.3 .4\n", "line 3", "without a wavelength"),
        (NO_SPHERES + b"r t S\n.3 .4 1\n", "line 10", "1 spheres"),
    ],
)
def test_a_wrong_file_is_answered_with_its_line(raw: bytes, place: str, found: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_rxt(raw, "wrong.rxt")
    assert (caught.value.file, caught.value.place) == ("wrong.rxt", place)
    assert found in caught.value.found
    assert caught.value.expected


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_rxt(tmp_path / "none.rxt")
    assert caught.value.file.endswith("none.rxt")


GOOD = HEAD + b"\n L r t\n500 .3 .4\n510 .31 .41\n"


@given(
    st.one_of(
        st.binary(max_size=200),
        st.binary(max_size=100).map(lambda tail: HEAD + tail),
        st.text("0123456789.-+eE rtuLnN#\nIADnai,", max_size=80).map(
            lambda tail: HEAD + b"\n" + tail.encode()
        ),
        st.tuples(st.integers(0, len(GOOD) - 1), st.binary(min_size=1, max_size=3)).map(
            lambda edit: GOOD[: edit[0]] + edit[1] + GOOD[edit[0] + 1 :]
        ),
    )
)
def test_any_bytes_give_a_visit_or_the_one_error(raw: bytes) -> None:
    refused: list[InputError] = []
    try:
        visit = parse_rxt(raw, "some.rxt")
    except InputError as error:
        refused.append(error)
    if refused:
        assert refused[0].file == "some.rxt"
        assert refused[0].found
        assert refused[0].expected
        return
    assert visit.rows >= 1
    assert visit.value.shape == (visit.rows, 3)
    assert np.array_equal(visit.valid, np.isfinite(visit.value))
    assert np.all((visit.n >= 1.0) & (visit.thickness_mm > 0.0))
