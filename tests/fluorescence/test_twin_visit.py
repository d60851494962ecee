"""Set-ups, simulated visits, corrections with honest errors, files, and bad input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.errors import InputError
from twin.fluorescence import (
    GRID_NM,
    SETUPS,
    FluorescenceData,
    FluorescenceProtocol,
    FluorescenceSetup,
    FluorescenceSystem,
    Led,
    as7341,
    binned_light,
    corrected,
    example,
    fitoolbox_max_relative_error,
    is_fluorescence_visit,
    light_set,
    named_setup,
    nominal_system,
    outside_share,
    plain_data,
    read_visit,
    simulate_fluorescence,
    write_counts_csv,
    write_visit,
)
from twin.fluorescence.readings import signals
from twin.toml import validate

PRICES = {"l1-s1": 2004, "l1-s2": 29, "l2-s1": 2165, "l2-s2": 190, "reference": 20500}


def test_the_five_setups_have_the_prices_of_the_seed():
    assert {name: named_setup(name).price_usd for name in SETUPS} == PRICES
    assert [len(named_setup(name).lights) for name in SETUPS] == [8, 8, 8, 8, 31]


def test_captures_are_the_double_sum_of_the_seed():
    system = nominal_system(named_setup("l1-s2"))
    matrix = example("yellow_and_pink")
    found = system.captures(matrix)
    by_hand = sum(
        system.sensitivities[3, o] * matrix.matrix[o, i] * system.illuminants[1, i]
        for o in range(31)
        for i in range(31)
    )
    assert found.shape == (8, 8)
    assert found[1, 3] == pytest.approx(by_hand)
    np.testing.assert_allclose(system.design() @ matrix.matrix.ravel(), found.ravel())


def test_fitoolbox_simulated_set_is_reproduced_to_1e_4(shared_data: Path):
    folder = shared_data / "fluorescence" / "fitoolbox"
    if not folder.is_dir():
        pytest.skip("fiToolbox's simulated set (fluorescence/fitoolbox) is absent")
    assert fitoolbox_max_relative_error(folder) < 1e-4


def test_an_led_has_its_width_and_moves_with_temperature_and_current():
    led = Led(name="red", peak_nm=630, fwhm_nm=18, nanometres_per_kelvin=0.12, per_kelvin=-0.006,
              nanometres_per_decade=1.0)  # fmt: skip
    fine = np.arange(580.0, 680.0, 0.01)
    shape = led.spectrum(fine)
    assert np.ptp(fine[shape >= 0.5]) == pytest.approx(18.0, abs=0.03)
    warm = led.spectrum(fine, warmer_k=20.0, drive=10.0)
    assert fine[np.argmax(warm)] == pytest.approx(630.0 + 2.4 + 1.0, abs=0.02)
    assert warm.max() == pytest.approx(10.0 * (1.0 - 0.12), rel=1e-6)


def test_bins_hold_the_energy_of_the_spectrum():
    lights = light_set("L1")
    wide = np.arange(300.0, 901.0, 10.0)
    fine = np.arange(295.0, 905.0, 0.1)
    total = np.array([each.spectrum(fine).sum() * 0.1 for each in lights])
    np.testing.assert_allclose(binned_light(lights, wide).sum(axis=1), total, rtol=1e-3)
    outside = outside_share(lights, GRID_NM)
    assert 0.05 < outside[0] < 0.3  # the violet LED reaches below 395 nm
    assert outside[3] < 1e-3


def test_near_ultraviolet_excitation_is_a_switch():
    off = nominal_system(named_setup("l2-s2"))
    on = nominal_system(named_setup("l2-s2", excitation_from_nm=300.0))
    assert off.illuminants.shape == (8, 31)
    assert on.illuminants.shape == (8, 41)
    assert on.illuminants[0, :10].sum() > 0.1 * on.illuminants[0].sum()
    paper = example("brightened_paper", GRID_NM, on.excitation_nm)
    gained = on.captures(paper)[0].sum() - off.captures(paper.on())[0].sum()
    assert gained > 0.05 * off.captures(paper.on())[0].sum()


def test_cells_that_no_capture_depends_on_are_named():
    system = nominal_system(named_setup("l1-s1"))
    assert not system.blind().any()
    red = FluorescenceSystem(system.illuminants[5:6], system.sensitivities)
    blind = red.blind()
    assert blind[20, 3]
    assert not blind[24, 23]


@pytest.mark.parametrize("name", ["l1-s1", "l1-s2", "l2-s1", "l2-s2"])
def test_corrected_captures_are_as_far_from_the_truth_as_their_covariance_says(name):
    # chi-square per capture over 12 visits with 12 detectors; covariances of a third and of three
    # times the size have to fail the same bounds.
    material = example("yellow_and_pink")
    ratios = []
    for seed in range(12):
        setup = named_setup(name)
        detector = setup.detector.model_copy(update={"serial": seed})
        setup = setup.model_copy(update={"detector": detector})
        data = corrected(simulate_fluorescence(setup, material, seed=seed))
        gap = (data.value - data.system.captures(data.truth)).ravel()
        ratios.append(float(gap @ np.linalg.solve(data.covariance, gap)) / gap.size)
    mean = np.mean(ratios)
    assert 0.6 < mean < 1.4, mean
    assert not 0.6 < 3.0 * mean < 1.4
    assert not 0.6 < mean / 3.0 < 1.4


@pytest.mark.parametrize("name", ["l1-s1", "l2-s1"])
def test_a_dark_that_white_and_sample_share_counts_once(name):
    # Without the fixed pattern, which is only approximated, the covariance is exact: 8 visits of
    # 248 captures, a standard error of 0.03. The control has a dark of its own for each.
    detector = named_setup(name).detector.model_copy(update={"photo_response_nonuniformity": 0.0})
    setup = named_setup(name).model_copy(update={"detector": detector})
    ratios, controls = [], []
    for seed in range(8):
        visit = simulate_fluorescence(setup, example("yellow_and_pink"), seed=seed)
        data, found = corrected(visit), signals(visit)
        gap = (data.value - data.system.captures(data.truth)).ravel()
        scale = np.nanmedian(found.sample / data.value)
        twice = data.covariance + np.diag((found.dark_variance / scale**2).ravel())
        ratios.append(float(gap @ np.linalg.solve(data.covariance, gap)) / gap.size)
        controls.append(float(gap @ np.linalg.solve(twice, gap)) / gap.size)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.12)
    assert np.mean(controls) < 0.85


def test_captures_below_zero_by_noise_are_kept_and_counted():
    """Clipped, they would pull dark captures up by what noise adds."""
    data = corrected(simulate_fluorescence(named_setup("l1-s1"), example("pink_paper"), seed=2))
    below = int((data.value[data.valid] < 0.0).sum())
    assert below > 0
    assert f"{below} captures are below 0 by noise and left so" in data.reasons
    dark = data.valid & (data.system.captures(data.truth) < 1e-4 * data.value.max())
    error = (data.value - data.system.captures(data.truth))[dark]
    sigma = np.sqrt(data.variance[dark])
    pull = error.mean() / (np.sqrt((sigma**2).sum()) / dark.sum())
    assert abs(pull) < 4.0


def test_noise_is_realistic_and_relative_to_the_brightest_small():
    data = corrected(simulate_fluorescence(named_setup("l1-s2"), example("pink_paper")))
    sigma = np.sqrt(np.diag(data.covariance)).reshape(data.value.shape)
    bright = data.value > 0.1 * data.value.max()
    relative = sigma[bright] / data.value[bright]
    assert 2e-4 < np.median(relative) < 5e-3


def test_the_same_seed_gives_the_same_visit_and_another_one_another():
    setup, material = named_setup("l2-s2"), example("green_marker")
    first = simulate_fluorescence(setup, material, seed=5)
    assert first == simulate_fluorescence(setup, material, seed=5)
    assert first != simulate_fluorescence(setup, material, seed=6)


def test_a_chip_reads_in_two_passes_with_lamps_of_their_own():
    setup = named_setup("l1-s2")
    np.testing.assert_array_equal(setup.passes, [0, 0, 0, 0, 1, 1, 1, 1])
    quiet = setup.detector.model_copy(
        update={"off": ("shot_noise", "read_noise", "quantisation"), "lamp_flicker": 0.05}
    )
    flickering = setup.model_copy(update={"detector": quiet})
    visit = simulate_fluorescence(flickering, example("white"))
    rows = [i for i, shot in enumerate(visit.shots) if shot.illuminant == "cool_white"]
    ratio = visit.counts[rows] / visit.counts[rows].mean(axis=0)
    assert np.corrcoef(ratio[:, 1], ratio[:, 2])[0, 1] > 0.999
    assert np.corrcoef(ratio[:, 1], ratio[:, 6])[0, 1] < 0.9


def test_cross_talk_and_near_infrared_leak_show_in_the_channels():
    wide = np.arange(400.0, 781.0, 10.0)
    base = {"name": "own", "lights": "L1", "price_usd": 29, "emission_to_nm": 780.0}
    plain, leaky = (
        validate(base | {"detector": as7341((400.0, 780.0), **options).model_dump()},
                 FluorescenceSetup)
        for options in ({"cross_talk": 0.0}, {"cross_talk": 0.2, "near_infrared_leak": 0.1})
    )  # fmt: skip
    first = nominal_system(plain).sensitivities[0]
    second = nominal_system(leaky).sensitivities[0]
    far, red = int(np.argmin(np.abs(wide - 600))), int(np.argmin(np.abs(wide - 770)))
    assert first[far] < 1e-9
    assert second[far] > 1e-3
    assert second[red] > 1.3 * second[far]


@pytest.mark.parametrize("name", ["l1-s1", "l2-s2"])
def test_a_visit_comes_back_from_its_file_and_the_file_is_the_same(tmp_path: Path, name):
    visit = simulate_fluorescence(named_setup(name), example("red_ink"), seed=2)
    path = write_visit(visit, tmp_path / "visit.nc")
    before = path.read_bytes()
    assert read_visit(path) == visit
    assert is_fluorescence_visit(path)
    write_visit(visit, path)
    assert path.read_bytes() == before
    path.write_bytes(before[:3000] + b"x" + before[3001:])
    with pytest.raises(InputError, match="damaged"):
        read_visit(path)
    path.write_bytes(before[:3000])
    with pytest.raises(InputError, match="truncated"):
        read_visit(path)


def _folder(tmp_path: Path, visit, detector: str = "S2") -> Path:
    folder = tmp_path / "visit"
    folder.mkdir(exist_ok=True)
    (folder / "visit.toml").write_text(
        f'sample = "mine"\n[setup]\nlights = "L1"\ndetector = "{detector}"\n'
    )
    write_counts_csv(visit, folder)
    return folder


def test_a_folder_made_by_hand_gives_the_same_captures(tmp_path: Path):
    visit = simulate_fluorescence(named_setup("l1-s2"), example("pink_paper"))
    folder = _folder(tmp_path, visit)
    back = read_visit(folder)
    assert is_fluorescence_visit(folder)
    assert back.sample == "mine"
    np.testing.assert_array_equal(back.counts, visit.counts)
    np.testing.assert_allclose(corrected(back).value, corrected(visit).value)


def test_a_fine_spectrum_is_averaged_into_the_bins(tmp_path: Path):
    visit = simulate_fluorescence(named_setup("l1-s1"), example("pink_paper"))
    folder = _folder(tmp_path, visit, "S1")
    lines = (folder / "counts.csv").read_text().splitlines()
    fine = np.arange(396.0, 705.0, 2.0)
    rows = [",".join([*lines[0].split(",")[:6], *(f"{w:g}" for w in fine)])]
    rows += [",".join([*line.split(",")[:6], *(["150"] * fine.size)]) for line in lines[1:]]
    (folder / "counts.csv").write_text("\n".join(rows))
    back = read_visit(folder)
    np.testing.assert_allclose(back.counts, 150.0)
    assert "155 samples of each spectrum averaged into 31 bins" in back.provenance.notes


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("F2,F3", "F3,F2", "another order"),
        ("integration_s", "seconds", "integration_s"),
        ("dark,,0", "dark,,0,7", "line 2"),
        ("white,violet,0", "white,purple,0", "purple"),
        ("white,violet,0", "white,violet,1", "second time"),
        ("white,violet,0", "grey,violet,0", "grey"),
        ("white,violet,0", "white,violet,0.5", "whole number"),
    ],
)
def test_a_wrong_folder_is_named(tmp_path: Path, old, new, message):
    folder = _folder(tmp_path, simulate_fluorescence(named_setup("l1-s2"), example("pink_paper")))
    path = folder / "counts.csv"
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        read_visit(folder)
    assert "counts.csv" in str(caught.value)


@pytest.mark.parametrize("name", ["l1-s1", "l1-s2", "l2-s1", "l2-s2", "reference"])
def test_channels_or_illuminants_in_the_wrong_order_are_found_on_the_white(name):
    visit = simulate_fluorescence(named_setup(name), example("yellow_highlighter"))
    swapped = visit.counts[:, ::-1]
    with pytest.raises(InputError, match="channels in another order"):
        corrected(replace(visit, counts=swapped))
    a, b = visit.setup.illuminant_names[0], visit.setup.illuminant_names[3]
    names = {a: b, b: a}
    shots = tuple(
        replace(shot, illuminant=names.get(shot.illuminant, shot.illuminant))
        for shot in visit.shots
    )
    with pytest.raises(InputError, match="in another order"):
        corrected(replace(visit, shots=shots))


@pytest.mark.parametrize("name", ["l1-s1", "l1-s2", "l2-s1", "l2-s2", "reference"])
def test_a_white_that_fluoresces_is_refused_and_a_plain_one_is_not(name):
    material = example("pink_paper")
    bad = named_setup(name, white_material="yellow_highlighter")
    with pytest.raises(InputError, match=r"without fluorescence|another order"):
        corrected(simulate_fluorescence(bad, material))
    assert corrected(simulate_fluorescence(named_setup(name), material)).valid.all()


def test_an_illuminant_that_the_detector_cannot_see_is_refused():
    lights = [
        {"kind": "led", "name": "blue", "peak_nm": 460, "fwhm_nm": 20},
        {"kind": "led", "name": "far", "peak_nm": 850, "fwhm_nm": 20},
    ]
    setup = validate({"name": "own", "lights": lights, "detector": "S1", "price_usd": 10},
                     FluorescenceSetup)  # fmt: skip
    with pytest.raises(InputError, match="far"):
        nominal_system(setup)
    near = named_setup("reference", excitation_from_nm=300.0)
    visit = simulate_fluorescence(near, example("brightened_paper", GRID_NM, near.excitation_nm))
    with pytest.raises(InputError, match="no channel of the detector sees"):
        corrected(visit)


def test_saturated_and_dead_channels_are_masked_and_counted():
    setup = named_setup("l1-s2")
    visit = simulate_fluorescence(setup, example("pink_paper"))
    saturated, counts = np.array(visit.saturated), np.array(visit.counts)
    rows = [i for i, s in enumerate(visit.shots) if (s.kind, s.illuminant) == ("sample", "green")]
    saturated[rows[0], 4] = True
    counts[rows[1], 6] = np.nan
    data = corrected(replace(visit, saturated=saturated, counts=counts))
    assert not data.valid[3, 4]
    assert not data.valid[3, 6]
    assert int((~data.valid).sum()) == 2
    assert np.isnan(data.value[3, 4])
    assert any("sample under 'green' saturated" in reason for reason in data.reasons)
    assert any("sample under 'green' not a number" in reason for reason in data.reasons)


def test_missing_darks_whites_and_lights_are_named():
    visit = simulate_fluorescence(named_setup("l1-s2"), example("pink_paper"))
    for kind, message in (("dark", "no dark for"), ("white", "no white under 'violet'")):
        kept = [i for i, shot in enumerate(visit.shots) if shot.kind != kind]
        fewer = replace(
            visit, shots=tuple(visit.shots[i] for i in kept), counts=visit.counts[kept],
            saturated=visit.saturated[kept],
        )  # fmt: skip
        with pytest.raises(InputError, match=message):
            corrected(fewer)
    counts = np.array(visit.counts)
    off = [i for i, s in enumerate(visit.shots) if (s.kind, s.illuminant) == ("white", "red")]
    gain = visit.shots[off[0]].gain
    darks = [i for i, s in enumerate(visit.shots) if (s.kind, s.gain) == ("dark", gain)]
    counts[off] = counts[darks].mean(axis=0)
    with pytest.raises(InputError, match="sees under 'red'"):
        corrected(replace(visit, counts=counts))


def test_noise_from_repeats_resembles_that_of_the_described_instrument():
    visit = simulate_fluorescence(
        named_setup("l1-s1"), example("pink_paper"),
        protocol=FluorescenceProtocol(repeats=8, white_repeats=8),
    )  # fmt: skip
    described = corrected(visit)
    repeated = corrected(
        replace(visit, provenance=visit.provenance.model_copy(update={"noise": "repeats"}))
    )
    bright = described.value > 0.05 * described.value.max()
    ratio = repeated.variance[bright] / described.variance[bright]
    assert 0.3 < np.median(ratio) < 3.0
    single = simulate_fluorescence(
        named_setup("l1-s1"), example("pink_paper"), protocol=FluorescenceProtocol(repeats=1)
    )
    alone = single.provenance.model_copy(update={"noise": "repeats"})
    with pytest.raises(InputError, match="two repeats"):
        corrected(replace(single, provenance=alone))


def test_wrong_noise_values_are_refused():
    system, matrix = nominal_system(named_setup("l1-s2")), example("pink_paper")
    data = plain_data(system, matrix)
    for wrong in (-1e-6, np.nan):
        variance = np.array(data.variance)
        variance[2, 3] = wrong
        with pytest.raises(InputError, match="negative or no number"):
            FluorescenceData(system, data.value, variance, data.common, data.valid)
    with pytest.raises(InputError, match="noise of 0 or more"):
        plain_data(system, matrix, relative_noise=-0.1)
    with pytest.raises(InputError, match="no number"):
        FluorescenceSystem(system.illuminants * np.nan, system.sensitivities)
    with pytest.raises(InputError, match="nothing in the bins of illuminant 'b'"):
        FluorescenceSystem(
            np.stack([np.ones(31), np.zeros(31)]), system.sensitivities,
            illuminant_names=("a", "b"),
        )  # fmt: skip


def test_wrong_setups_are_named():
    with pytest.raises(InputError, match="l1-s1"):
        named_setup("l3-s1")
    with pytest.raises(InputError, match="multiple of 10"):
        named_setup("l1-s1", excitation_from_nm=395.0)
    with pytest.raises(InputError, match="price"):
        validate({"lights": [{"kind": "led", "name": "a", "peak_nm": 450, "fwhm_nm": 20}],
                  "detector": "S1"}, FluorescenceSetup)  # fmt: skip
    with pytest.raises(InputError, match="L1, L2 or monochromator"):
        validate({"lights": "L9", "detector": "S1"}, FluorescenceSetup)
