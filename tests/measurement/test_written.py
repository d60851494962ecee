"""A measurement as a folder of tables that reads back as the same object."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.measurement.visits import visit
from tests.scenarios.tiny import answer, call
from twin.bench import Bench, Layer, Medium, Sample
from twin.errors import InputError
from twin.measurement import (
    Measurement,
    Provenance,
    RelativeRow,
    RelativeSpectra,
    Truth,
    read_measurement,
    read_netcdf,
    write_folder,
    write_measurement,
)
from twin.measurement.written import toml_text
from twin.spectra import SpectralTable

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"


def simulated() -> Measurement:
    """A visit with everything that a measurement can hold."""
    found = visit()
    captures = found.captures
    assert captures is not None
    counts = captures.counts.copy()
    counts[6, 1] = np.nan
    saturated = captures.saturated.copy()
    saturated[6, 2] = True
    light_se = np.linspace(1e-4, 2e-4, 2 * 3 * 3).reshape(2, 3, 3)
    truth = Truth(
        np.array([440.0, 500.1, 660.0]), np.full((2, 3), 1 / 3), np.full((2, 3), 0.1),
        np.full((2, 3), 1e-17),
    )  # fmt: skip
    return replace(
        found,
        captures=replace(captures, counts=counts, saturated=saturated, light_se=light_se),
        truth=truth,
        provenance=Provenance(
            origin="simulated", seed=7, software='benchtwin "0"', scenario="a\nb\t\x7f é",
            notes=("one", "two, three"), serial_numbers=("A,1",),
        ),
    )  # fmt: skip


def test_everything_comes_back(tmp_path: Path) -> None:
    measurement = simulated()
    found = read_measurement(write_folder(measurement, tmp_path / "tables"))
    assert found == measurement
    assert found.provenance == measurement.provenance
    np.testing.assert_array_equal(found.captures.counts, measurement.captures.counts)


@pytest.mark.parametrize("name", ["hand_made", "hand_made_relative"])
def test_the_examples_come_back(name: str, tmp_path: Path) -> None:
    measurement = read_measurement(EXAMPLES / name)
    assert read_measurement(write_folder(measurement, tmp_path / "tables")) == measurement


def test_samples_that_a_table_cannot_hold(tmp_path: Path) -> None:
    table = SpectralTable(wavelength_nm=(400.0, 700.0), value=(1.52, 1.5))
    medium = Medium(albedo=table, sigma_t_per_mm=3.0, g=0.4)
    found = simulated()
    samples = (
        Sample(name="a", thickness_mm=0.4, n=table, material=medium),
        Sample(name="b", thickness_mm=0.8, n="water", material="demo_ink"),
    )
    bench = found.bench.model_copy(update={
        "size_mm": None, "covers_above": (Layer(thickness_mm=1.0, n=1.5, medium=medium),),
    })  # fmt: skip
    measurement = replace(found, samples=samples, bench=bench)
    folder = write_folder(measurement, tmp_path / "tables")
    assert not (folder / "samples.csv").exists()
    assert read_measurement(folder) == measurement
    text = (folder / "samples.toml").read_text()
    (folder / "samples.toml").write_text(text.replace('name = "b"', 'name = "a"'))
    with pytest.raises(InputError, match=r"samples\[1\].name: found 'a' twice"):
        read_measurement(folder)
    (folder / "samples.csv").write_text("name,thickness_mm\na,1\n")
    with pytest.raises(InputError, match=r"samples.csv and .*samples.toml; expected one of them"):
        read_measurement(folder)


def test_a_folder_that_was_changed_says_so(tmp_path: Path) -> None:
    folder = write_folder(simulated(), tmp_path / "tables")
    path = folder / "captures.csv"
    text = path.read_text()
    path.write_text(text.replace("10100.0", "10101.0", 1))
    assert path.read_text() != text
    found = read_measurement(folder)
    assert found.provenance.origin == "handmade"
    assert found.provenance.seed is None
    assert found.provenance.notes[-1] == (
        "changed by hand since benchtwin wrote the folder (it came from simulated data)"
    )
    path.write_text(text)
    assert read_measurement(folder) == simulated()


def test_relative_intensities_with_gaps(tmp_path: Path) -> None:
    rows = tuple(RelativeRow(s, c) for s in "ab" for c in ("black", "white", "collimated"))
    value = np.linspace(0.1, 0.7, 18).reshape(6, 3)
    sigma = np.full((6, 3), 0.01)
    value[0, 1] = np.nan
    wavelength = np.array([450.0, 550.0, 650.0])
    found = visit()
    measurement = replace(
        found, captures=None, relative=RelativeSpectra(rows, wavelength, value, sigma)
    )
    assert read_measurement(write_folder(measurement, tmp_path / "t")) == measurement


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("notes")
    with pytest.raises(InputError, match=r"a folder with mine\.txt in it"):
        write_folder(visit(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    bad = replace(
        visit(samples=("a",)), samples=(Sample(name=" a", thickness_mm=1.0),), captures=None,
        relative=RelativeSpectra((RelativeRow(" a", "black"),), np.array([500.0]),
                                 np.array([[0.5]]), np.array([[0.1]])),
    )  # fmt: skip
    with pytest.raises(InputError, match="the sample ' a'"):
        write_folder(bad, tmp_path / "new")


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("truth.csv", "440.0", "441.0", "found other wavelengths of b"),
        ("light_se.csv", "450.0", "451.0", "found other wavelengths of a black"),
        ("origin.toml", "fingerprint", "fingerprnt", "Did you mean `fingerprint`"),
        ("captures.csv", "missing", "mising", "found 'mising'; expected a number"),
    ],
)
def test_mistakes(name: str, old: str, new: str, message: str, tmp_path: Path) -> None:
    folder = write_folder(simulated(), tmp_path / "tables")
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_measurement(folder)
    assert message in str(caught.value)


def test_the_command_converts_both_ways(tmp_path: Path) -> None:
    measurement = simulated()
    start = write_measurement(measurement, tmp_path / "start.nc")
    tables = answer(call("convert", start, tmp_path / "tables", "--json"))
    assert "captures.csv" in tables["files"]
    back = answer(call("convert", tmp_path / "tables", tmp_path / "back.nc", "--json"))
    assert back["fingerprint"] == tables["fingerprint"] == measurement.fingerprint
    assert (tmp_path / "back.nc").read_bytes() == start.read_bytes()
    assert read_netcdf(tmp_path / "back.nc") == measurement
    for arguments in (
        (start, tmp_path / "tables"), (start, start), (tmp_path / "none.nc", tmp_path / "x"),
    ):  # fmt: skip
        result = call("convert", *arguments)
        assert result.exit_code == 2
        assert result.stderr.count("benchtwin: ") == 1


_VALUES = st.recursive(
    st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.booleans(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"]), max_size=4), inner)
    ),
    max_leaves=6,
)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.dictionaries(st.text(st.characters(exclude_categories=["Cs"]), max_size=6), _VALUES))
def test_toml_that_is_written_is_read(table: dict[str, object]) -> None:
    assert tomllib.loads(toml_text(table)) == table
    assert tomllib.loads(toml_text(Bench().model_dump(mode="json")))["beam"]["diameter_mm"] == 1.0
