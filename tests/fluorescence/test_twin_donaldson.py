"""Donaldson matrices: units, readers, constructors, sums, exports, and bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.errors import InputError
from twin.fluorescence import (
    FLUOROPHORES,
    GRID_NM,
    MATERIALS,
    DonaldsonMatrix,
    Gaussian,
    MixtureModel,
    dyed,
    example,
    fluorophore,
    from_mixture,
    from_photons,
    gaussian_mixture,
    parse_bfc,
    product,
    read_bfc,
    read_matrix_csv,
    read_mixture,
    to_photons,
    write_matrix_csv,
    write_mixture,
)

BFC = """VEC_01\t12
BFC-450 Matrix File
;small.bfc
;Small sample
400\t420\t10\t4\t390\t10
r:c:\t390\t400\t410\t420
400\t0.01\t0.5\t0.001\t-0.002
410\t0.02\t0.03\t0.6\t0.0

420\t0.03\t-0.04\t0.05\t0.7
EOD
"""


def test_a_photon_that_becomes_redder_loses_the_energy_of_the_shift():
    photons = np.zeros((31, 31))
    photons[20, 5] = 1.0  # every photon of 450 nm comes back at 600 nm
    energy = from_photons(photons)
    assert energy[20, 5] == pytest.approx(450.0 / 600.0)
    np.testing.assert_allclose(to_photons(energy), photons)


def test_the_photon_yield_of_a_dye_is_its_quantum_yield():
    dye = fluorophore("fluorescein")
    wide = np.arange(300.0, 901.0, 10.0)
    matrix = DonaldsonMatrix(from_photons(dye.photons(1.0, wide, wide), wide, wide), wide, wide)
    at_350 = matrix.photon_yield[5] / dye.excitation.at(350.0)
    assert at_350 == pytest.approx(dye.quantum_yield, rel=1e-3)


def test_no_example_gives_more_photons_than_it_gets():
    wide = np.arange(300.0, 701.0, 10.0)
    for name in MATERIALS:
        matrix = example(name, GRID_NM, wide)
        total = matrix.photon_yield
        total[10:] += matrix.reflectance
        assert np.all(matrix.matrix >= 0.0)
        assert total.max() <= 1.0, name
    assert len(FLUOROPHORES) >= 5


def test_a_mixture_has_its_weight_as_its_sum():
    # Far above the diagonal a Gaussian sums to weight / step^2.
    cells = gaussian_mixture([30.0], [[460.0, 600.0]], [[200.0, 300.0]])
    assert cells.sum() * 100.0 == pytest.approx(30.0, rel=1e-3)
    assert np.all(np.triu(cells) == 0.0)
    low = gaussian_mixture([30.0], [[600.0, 460.0]], [[200.0, 300.0]])
    assert low.sum() < 1e-3


@pytest.mark.parametrize(
    ("weight", "variance"), [(-1.0, 100.0), (1.0, 0.0), (np.nan, 100.0), (1.0, np.inf)]
)
def test_impossible_gaussians_are_refused(weight, variance):
    with pytest.raises(InputError, match="Gaussian 1"):
        gaussian_mixture([weight], [[450.0, 550.0]], [[variance, 100.0]])


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 30), st.integers(0, 30), st.floats(1e-9, 0.5))
def test_energy_below_the_diagonal_is_an_error_or_removed_and_counted(row, column, energy):
    matrix = np.diag(np.full(31, 0.5))
    matrix[row, column] += energy
    if row >= column:
        assert DonaldsonMatrix(matrix).notes == ()
        return
    with pytest.raises(InputError, match="energy below the diagonal"):
        DonaldsonMatrix(matrix)
    removed = DonaldsonMatrix(matrix, below="zero")
    assert removed.matrix[row, column] == 0.0
    assert "below the diagonal removed" in removed.notes[0]
    assert DonaldsonMatrix(matrix, below="keep").matrix[row, column] == energy


def test_cells_that_are_no_number_are_refused_by_place():
    matrix = np.diag(np.full(31, 0.5))
    matrix[12, 3] = np.nan
    with pytest.raises(InputError, match="emission 520 nm, excitation 430 nm"):
        DonaldsonMatrix(matrix)


def test_negative_noise_is_kept_until_it_is_lit_and_then_counted():
    matrix = np.diag(np.full(31, 0.5))
    matrix[20, 3] = -0.004
    held = DonaldsonMatrix(matrix)
    assert held.matrix[20, 3] == -0.004
    lit = held.physical()
    assert lit.matrix.min() == 0.0
    assert "1 negative cells (-0.004) set to 0" in lit.notes


def test_wavelengths_are_cut_and_never_interpolated():
    wide = example("green_marker", GRID_NM, np.arange(300.0, 701.0, 10.0))
    cut = wide.on()
    np.testing.assert_array_equal(cut.matrix, example("green_marker").matrix)
    assert cut.wavelength_nm.size == 31
    with pytest.raises(InputError, match="Nothing is interpolated"):
        cut.on(np.arange(405.0, 700.0, 10.0))
    with pytest.raises(InputError, match="the same wavelengths"):
        _ = wide.wavelength_nm


def test_two_fluorophores_keep_the_first_reflectance():
    first, second = example("yellow_highlighter"), example("pink_paper")
    both = first.with_fluorescence_of(second)
    np.testing.assert_array_equal(both.reflectance, first.reflectance)
    np.testing.assert_allclose(both.fluorescence, first.fluorescence + second.fluorescence)
    assert both.name == "yellow_highlighter + pink_paper"


def test_measured_spectra_make_a_product():
    ex, em = np.exp(-(((GRID_NM - 450) / 30) ** 2)), np.exp(-(((GRID_NM - 560) / 30) ** 2))
    cells = product(ex, em, 0.4)
    column = int(np.argmax(ex))
    assert to_photons(cells)[:, column].sum() == pytest.approx(0.4, rel=1e-3)
    for bad in (-em, em * np.nan, em * 0.0):
        with pytest.raises(InputError, match="negative, no numbers or all 0"):
            product(ex, bad, 0.4)


def test_a_bfc_file_is_read_with_its_noise_on_request():
    found = parse_bfc(BFC.encode())
    assert found.name == "Small sample"
    np.testing.assert_array_equal(found.emission_nm, [400.0, 410.0, 420.0])
    np.testing.assert_array_equal(found.excitation_nm, [390.0, 400.0, 410.0, 420.0])
    np.testing.assert_array_equal(found.reflectance, [0.5, 0.6, 0.7])
    assert found.matrix[0, 3] == 0.0
    assert found.matrix[2, 1] == -0.04
    assert parse_bfc(BFC.encode(), below="keep").matrix[0, 3] == -0.002


@pytest.mark.parametrize(
    ("old", "new", "place", "what"),
    [
        ("VEC_01", "YYY", "line 1", "VEC_01"),
        ("BFC-450 Matrix File", "other", "line 2", "BFC-450"),
        ("390\t400\t410\t420", "390\t400\t410\t430", "line 6", "420 nm"),
        ("0.02\t0.03\t0.6", "0.02\t0,03\t0.6", "line 8", "decimal point"),
        ("410\t0.02", "415\t0.02", "line 8", "row of 410"),
        ("0.05\t0.7", "0.05", "line 10", "4 numbers"),
        ("0.02\t0.03\t0.6", "nan\t0.03\t0.6", "line 8", "a number"),
        ("EOD\n", "", "line 10", "cut off"),
        ("400\t420\t10\t4\t390\t10", "400\t425\t10\t4\t390\t10", "line 5", "grid"),
    ],
)
def test_a_wrong_bfc_file_is_named_by_line(tmp_path: Path, old, new, place, what):
    path = tmp_path / "sample.BFC"
    path.write_text(BFC.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_bfc(path)
    text = str(caught.value)
    assert str(path) in text
    assert place in text
    assert what in text


def test_the_five_measured_files_equal_the_derived_arrays(shared_data: Path):
    folder = shared_data / "fluorescence"
    if not (folder / "donaldson_bfc450.npz").is_file():
        pytest.skip("the measured matrices (fluorescence/donaldson_bfc450.npz) are absent")
    arrays = np.load(folder / "donaldson_bfc450.npz")
    files = sorted((folder / "gonzalez_bfc").glob("*.BFC"))
    assert len(files) == 5
    for file in files:
        found = read_bfc(file, below="keep")
        np.testing.assert_array_equal(found.matrix, arrays[file.stem])
        np.testing.assert_array_equal(found.excitation_nm, arrays["wi"])
        assert read_bfc(file).on().physical().photon_yield.max() < 1.0


def test_a_matrix_comes_back_exactly_from_csv(tmp_path: Path):
    matrix = example("yellow_and_pink", GRID_NM, np.arange(380.0, 701.0, 10.0))
    back = read_matrix_csv(write_matrix_csv(matrix, tmp_path / "m.csv"))
    np.testing.assert_array_equal(back.matrix, matrix.matrix)
    np.testing.assert_array_equal(back.excitation_nm, matrix.excitation_nm)
    lines = (tmp_path / "m.csv").read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join([*lines[:4], lines[4] + ",1"]))
    with pytest.raises(InputError, match="line 5"):
        read_matrix_csv(tmp_path / "short.csv")
    (tmp_path / "word.csv").write_text("\n".join([*lines[:2], lines[2].replace("410,", "410,x")]))
    with pytest.raises(InputError, match="line 3"):
        read_matrix_csv(tmp_path / "word.csv")


def test_a_mixture_comes_back_from_json_with_its_diagonal(tmp_path: Path):
    gaussian = Gaussian(
        weight=20.0, excitation_nm=450.0, emission_nm=540.0,
        excitation_variance_nm2=400.0, emission_variance_nm2=500.0,
    )  # fmt: skip
    model = MixtureModel(name="ours", gaussians=(gaussian,), moments=(0.6, 0.1, -0.02))
    back = read_mixture(write_mixture(model, tmp_path / "m.json"))
    assert back == model
    matrix = from_mixture(back)
    assert np.all((matrix.reflectance > 0.0) & (matrix.reflectance < 1.0))
    peak = 20.0 / (2.0 * np.pi * np.sqrt(400.0 * 500.0))
    assert matrix.matrix[14, 5] == pytest.approx(peak)
    flat = from_mixture(model, reflectance=0.3)
    np.testing.assert_allclose(flat.reflectance, 0.3)
    with pytest.raises(InputError, match="between 0 and 1"):
        from_mixture(model.model_copy(update={"moments": (0.5, 0.4)}))
    (tmp_path / "other.json").write_text('{"format": "x"}')
    with pytest.raises(InputError, match="another make"):
        read_mixture(tmp_path / "other.json")
    (tmp_path / "bad.json").write_text((tmp_path / "m.json").read_text().replace("20.0", "-20.0"))
    with pytest.raises(InputError, match="weight"):
        read_mixture(tmp_path / "bad.json")


def test_unknown_names_and_shares_are_refused():
    with pytest.raises(InputError, match="fluorescein"):
        fluorophore("fluoresceine")
    with pytest.raises(InputError, match="pink_paper"):
        example("pink paper")
    with pytest.raises(InputError, match="share"):
        dyed(0.9, {"fluorescein": 1.2})
