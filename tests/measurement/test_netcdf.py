"""One file: round trips, equal bytes, damaged and foreign files."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tests.measurement.visits import WAVELENGTH_NM, answer_of, readings, visit
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.measurement import (
    CAPTURES,
    SAMPLE_CAPTURES,
    Captures,
    Measurement,
    Provenance,
    RelativeRow,
    RelativeSpectra,
    Shot,
    Truth,
    read_measurement,
    write_measurement,
)

ROOT = Path(__file__).resolve().parents[2]


def _truth(samples: int = 2) -> Truth:
    wavelength = np.array([400.0, 700.0])
    return Truth(
        wavelength, np.full((samples, 2), 0.9), np.full((samples, 2), 2.0), np.zeros((samples, 2))
    )


def _full() -> Measurement:
    return visit(truth=_truth())


_texts = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=1, max_size=12
)
_numbers = st.floats(0, 1e6, allow_subnormal=False)
_positive = st.floats(1e-3, 1e3)


@st.composite
def measurements(draw: st.DrawFn) -> Measurement:
    """Any visit: names in any script, dead and saturated pixels, counts or ready-made values."""
    names = draw(st.lists(_texts, min_size=1, max_size=3, unique=True))
    width = draw(st.integers(1, 5))
    wavelength = 400.0 + np.cumsum(draw(arrays.arrays(float, width, elements=_positive)))
    key = st.tuples(st.sampled_from(SAMPLE_CAPTURES), st.sampled_from(names), st.integers(0, 3))
    keys = draw(st.lists(key, min_size=1, max_size=6, unique=True))
    values = arrays.arrays(float, (len(keys), width), elements=_numbers | st.just(np.nan))
    captures = relative = None
    if draw(st.booleans()):
        shots = tuple(
            Shot(
                capture if draw(st.booleans()) else CAPTURES[index % 4],
                draw(_positive),
                sample,
                repeat * 10 + index,
                draw(st.integers(1, 100)),
                draw(_numbers),
                draw(_positive),
            )
            for index, (capture, sample, repeat) in enumerate(keys)
        )
        mask = draw(arrays.arrays(bool, (len(keys), width)))
        captures = Captures(shots, wavelength, draw(values), mask)
    else:
        rows = tuple(RelativeRow(sample, capture, repeat) for capture, sample, repeat in keys)
        sigma = arrays.arrays(float, (len(keys), width), elements=_positive | st.just(np.nan))
        relative = RelativeSpectra(rows, wavelength, draw(values), draw(sigma))
    return Measurement(
        bench=Bench(panel_spectrum=draw(_texts)),
        samples=tuple(Sample(name=name, thickness_mm=draw(_positive)) for name in names),
        captures=captures,
        relative=relative,
        provenance=Provenance(seed=draw(st.none() | st.integers(0, 2**63)), scenario=draw(_texts)),
        truth=_truth(len(names)) if draw(st.booleans()) else None,
    )


@given(measurement=measurements())
def test_round_trip(measurement: Measurement, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("trip") / "visit.nc"
    again = read_measurement(write_measurement(measurement, path))
    assert again == measurement
    assert again.bench == measurement.bench
    assert again.samples == measurement.samples
    if measurement.captures is not None and again.captures is not None:
        assert again.captures.shots == measurement.captures.shots
        np.testing.assert_array_equal(again.captures.counts, measurement.captures.counts)


def test_equality_sees_every_number() -> None:
    base, table = _full(), readings()
    table[3][1][1] += 1e-9
    assert visit(table, truth=_truth()) != base
    assert visit(truth=None) != base
    assert visit(truth=_truth(), provenance=Provenance(seed=8)) != base
    assert _full() == base


def test_the_same_measurement_gives_the_same_bytes(tmp_path: Path) -> None:
    first = write_measurement(_full(), tmp_path / "first.nc").read_bytes()
    code = (
        "import sys; from tests.measurement.test_netcdf import _full;"
        "from twin.measurement import write_measurement; write_measurement(_full(), sys.argv[1])"
    )
    other = tmp_path / "another name.nc"
    environment = os.environ | {"PYTHONHASHSEED": "77", "TZ": "Asia/Tokyo"}
    subprocess.run(
        [sys.executable, "-c", code, str(other)], check=True, cwd=ROOT, env=environment, timeout=120
    )
    assert other.read_bytes() == first
    changed = write_measurement(visit(), tmp_path / "changed.nc").read_bytes()
    assert changed != first


def test_units_and_names_are_in_the_file(tmp_path: Path) -> None:
    """Any program that reads netCDF-4 finds its way, without us."""
    import xarray

    path = write_measurement(_full(), tmp_path / "visit.nc")
    with xarray.open_datatree(path, engine="h5netcdf", decode_times=False) as tree:
        assert tree["captures/counts"].attrs["units"] == "count"
        assert tree["captures/wavelength_nm"].attrs["units"] == "nm"
        assert tree["captures/integration_s"].attrs["units"] == "s"
        assert tree["samples/thickness_mm"].attrs["units"] == "mm"
        assert tree["truth/sigma_t_per_mm"].attrs["units"] == "1/mm"
        assert Bench.model_validate_json(tree["bench"].values.item()) == _full().bench
        numeric = [
            v for node in tree.subtree for v in node.variables.values() if v.dtype.kind in "fi"
        ]
        assert len(numeric) >= 12
        assert all("units" in variable.attrs for variable in numeric)


def test_long_texts_fit(tmp_path: Path) -> None:
    """HDF5 holds no attribute above 64 kB; a scenario with measured spectra is longer."""
    long = visit(provenance=Provenance(scenario="x = 1.2345\n" * 20_000))
    assert read_measurement(write_measurement(long, tmp_path / "long.nc")) == long


def test_nothing_half_written(tmp_path: Path) -> None:
    path = tmp_path / "visit.nc"
    write_measurement(visit(), path)
    with pytest.raises(InputError, match="cannot be written"):
        write_measurement(visit(), tmp_path / "nowhere" / "visit.nc")
    (tmp_path / "folder.nc").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_measurement(visit(), tmp_path / "folder.nc")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder.nc", "visit.nc"]
    write_measurement(_full(), path)
    assert read_measurement(path) == _full()


def test_arrays_cannot_be_changed() -> None:
    source = np.ones((1, 3))
    captures = Captures((Shot("dark", 1.0),), WAVELENGTH_NM, source, source > 2)
    source[0, 0] = 5.0
    assert captures.counts[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        captures.counts[0, 0] = 2.0


# --- files that are not ours, or no longer --------------------------------------------------


@pytest.fixture(scope="module")
def valid_bytes(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write_measurement(_full(), tmp_path_factory.mktemp("v") / "visit.nc").read_bytes()


def _result_or_clear_error(content: bytes, folder: Path) -> Measurement | InputError:
    path = folder / f"{hashlib.sha256(content).hexdigest()[:16]}.nc"
    path.write_bytes(content)
    measurement, error = answer_of(lambda: read_measurement(path))
    if error is None:
        assert measurement is not None
        return measurement
    assert error.file == str(path)
    assert error.found
    assert error.expected
    return error


@given(content=st.binary(max_size=300))
def test_random_bytes(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("random")
    for prefix in (b"", b"\x89HDF\r\n\x1a\n"):
        assert isinstance(_result_or_clear_error(prefix + content, folder), InputError)


@given(data=st.data())
def test_truncated(
    data: st.DataObject, valid_bytes: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    cut = data.draw(st.integers(0, len(valid_bytes) - 1))
    answer = _result_or_clear_error(valid_bytes[:cut], tmp_path_factory.mktemp("cut"))
    assert isinstance(answer, InputError)


@given(data=st.data())
def test_changed_bytes(
    data: st.DataObject, valid_bytes: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    content = bytearray(valid_bytes)
    places = data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=8))
    for place in places:
        content[place] = data.draw(st.integers(0, 255))
    answer = _result_or_clear_error(bytes(content), tmp_path_factory.mktemp("changed"))
    if bytes(content) == valid_bytes:
        assert answer == _full()
    else:
        assert isinstance(answer, InputError)


def _sealed(body: bytes) -> bytes:
    return body + b"\nbenchtwin-sha256:" + hashlib.sha256(body).hexdigest().encode() + b"\n"


def test_foreign_netcdf(tmp_path: Path) -> None:
    import xarray

    path = tmp_path / "foreign.nc"
    xarray.Dataset({"x": ("i", [1.0])}).to_netcdf(path, engine="h5netcdf")
    body = path.read_bytes()
    assert "no checksum" in str(_result_or_clear_error(body, tmp_path))
    assert "the title None" in str(_result_or_clear_error(_sealed(body), tmp_path))
    for attributes, message in (
        ({"title": "benchtwin measurement", "format_version": 99}, "format version 99"),
        ({"title": "benchtwin measurement", "format_version": 1}, "another make"),
    ):
        xarray.Dataset({"x": ("i", [1.0])}, attrs=attributes).to_netcdf(path, engine="h5netcdf")
        answer = _result_or_clear_error(_sealed(path.read_bytes()), tmp_path)
        assert message in str(answer)


def test_a_bench_that_is_not_valid(tmp_path: Path) -> None:
    import h5py

    path = write_measurement(visit(), tmp_path / "visit.nc")
    with h5py.File(path, "r+") as file:
        file["bench"][()] = file["bench"][()].replace(b'"gap_mm":0.5', b'"gap_mm":-0.5')
    body = path.read_bytes().partition(b"\nbenchtwin-sha256:")[0]
    answer = _result_or_clear_error_of(path, _sealed(body))
    assert answer.place == "background.gap_mm"


def _result_or_clear_error_of(path: Path, content: bytes) -> InputError:
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_measurement(path)
    return caught.value


@pytest.mark.parametrize("name", ["missing.nc", "missing", ""])
def test_no_such_file(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_measurement(tmp_path / name)
