"""TOML files: every kind of mistake has its place and a remedy."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.measurement.visits import answer_of
from twin.bench import Bench
from twin.errors import InputError
from twin.toml import load_toml, parse_toml, validate


def test_a_bench(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_bytes(b"\xef\xbb\xbfcovers_above = []\n[background]\ngap_mm = 0.25\n")
    bench = load_toml(path, Bench)
    assert bench.covers_above == ()
    assert bench.background.gap_mm == 0.25
    assert load_toml(path, Bench) == bench


@pytest.mark.parametrize(
    ("text", "place", "parts"),
    [
        ("gap = 1", "gap", ("unknown key `gap`", "background")),
        ("[detecter]\n", "detecter", ("Did you mean `detector`?",)),
        ("[detector]\nspot_beam = 3", "detector.spot_beam", ("Did you mean `spot_beam_mm`?",)),
        ("[beam]\ndiameter_mm = -1", "beam.diameter_mm", ("found -1", "greater than 0")),
        ("[beam]\ndiameter_mm = 'wide'", "beam.diameter_mm", ("found 'wide'", "a number")),
        ("[[covers_above]]\nn = 1.5", "covers_above[0].thickness_mm", ("no key `thickness_mm`",)),
        ("[[covers_above]]\nthickness = 1", "covers_above[0].thickness", ("Did you mean",)),
        (
            "[[covers_above]]\nthickness_mm = 1\nn = {wavelength_nm = [500, 400], value = [1, 1]}",
            "covers_above[0].n",
            ("400 nm after 500 nm", "increase"),
        ),
        (
            "[[covers_above]]\nthickness_mm = 1\nn = { wavelengths = [4, 5], value = [1, 1] }",
            "covers_above[0].n.wavelengths",
            ("Did you mean `wavelength_nm`?",),
        ),
        ("panels = []", "panels", ("0 panels", "1 to 8")),
        ("size_mm = [1.0]", "size_mm[1]", ()),
        ("size_mm = [1.0, -2.0]", "size_mm", ("two lengths above 0",)),
        ("[instrument]\nkind = 'camera'", "instrument", ()),
        ("[instrument]\nkind = 'chip'\ngain = 3.0", "instrument.gain", ("found 3", "one of 0.5")),
    ],
)
def test_place_and_remedy(text: str, place: str, parts: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as caught:
        parse_toml(text, Bench, file="bench.toml")
    message = str(caught.value)
    assert caught.value.place == place, message
    assert caught.value.file == "bench.toml"
    assert "pydantic" not in message
    assert "\n" not in message
    for part in parts:
        assert part in message, message


def test_syntax_errors_say_the_line(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text("[beam]\n\ndiameter_mm = 1,5\n")
    with pytest.raises(InputError, match=r"x.toml: line 3, column"):
        load_toml(path, Bench)
    path.write_text("[beam]\ndiameter_mm =")
    with pytest.raises(InputError, match=r"line 2"):
        load_toml(path, Bench)
    with pytest.raises(InputError, match="no such file"):
        load_toml(tmp_path / "none.toml", Bench)
    with pytest.raises(InputError, match="cannot be read"):
        load_toml(tmp_path, Bench)


def test_several_mistakes_are_all_named() -> None:
    with pytest.raises(InputError, match=r"Also wrong: detector.acceptance_deg"):
        parse_toml("[beam]\ndiameter_mm = 0\n[detector]\nacceptance_deg = 90", Bench)


_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


@given(key=st.sampled_from(sorted(Bench.model_fields)), value=_values)
def test_any_value_anywhere(key: str, value: object) -> None:
    bench, error = answer_of(lambda: validate({key: value}, Bench, file="f.toml"))
    if error is None:
        assert isinstance(bench, Bench)
    else:
        assert error.place.startswith(key)
        assert error.found


@given(content=st.binary(max_size=200))
def test_any_bytes(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("toml") / "x.toml"
    path.write_bytes(content)
    bench, error = answer_of(lambda: load_toml(path, Bench))
    if error is None:
        assert isinstance(bench, Bench)
    else:
        assert error.file == str(path)
