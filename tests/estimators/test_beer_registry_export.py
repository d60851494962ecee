from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import estimators
from estimators import (
    BeerEstimator,
    BenchModel,
    EstimateResult,
    Estimator,
    LutEstimator,
    LutSettings,
    Status,
)
from estimators import registry as registry_module
from estimators.result import QUANTILE_LEVELS, gaussian_quantiles
from tests.estimators.fake_map import fake_map
from tests.estimators.visits import bench_model, generator, materials, visit
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities
from twin.optics import stack_transmittance

MAPS = (fake_map(0.4, shape=(12, 14, 5)), fake_map(0.8, shape=(12, 14, 5)))


def through(model: BenchModel, sigma_t: float, noise: float, seed: int = 0) -> RelativeIntensities:
    """A visit whose collimated captures follow Beer's law exactly, but for noise."""
    count = model.wavelength_nm.size
    measured = visit(model, materials(count), noise=0.01)
    value, covariance = measured.value.copy(), measured.covariance.copy()
    for s, thickness in enumerate(measured.thickness_mm):
        share = stack_transmittance(np.exp(-sigma_t * thickness), model.windows(s))
        value[s, 2] = share + noise * generator(seed, s).standard_normal(count)
        covariance[:, 3 * s + 2, 3 * s + 2] = noise**2
    return replace(measured, value=value, covariance=covariance)


def lut_result() -> EstimateResult:
    model = bench_model(12, MAPS)
    measured = visit(model, materials(12), noise=0.01)
    valid = measured.valid.copy()
    valid[:, :, 3] = False
    settings = LutSettings(draws=60)
    return LutEstimator(model, settings).estimate(replace(measured, valid=valid))


def test_beer_is_exact_without_scattering() -> None:
    model = replace(bench_model(20, MAPS), covers_above=(np.full(20, 1.52),))
    result = BeerEstimator(model).estimate(through(model, 2.5, 0.0))
    np.testing.assert_allclose(result.sigma_t_per_mm, 2.5, rtol=1e-10)
    assert (result.status == Status.NO_NOISE_STATED).all()
    np.testing.assert_allclose(result.residual[:, 2], 0.0, atol=1e-12)


def test_beer_covers_the_truth_and_an_understated_noise_does_not() -> None:
    model = bench_model(2000, MAPS)
    measured = through(model, 2.0, 0.002)
    shares = []
    for understated in (1.0, 2.0):
        covariance = measured.covariance / understated**2
        result = BeerEstimator(model).estimate(replace(measured, covariance=covariance))
        low, high = result.interval(0.90)[:, :, 1]
        shares.append(np.mean((low <= 2.0) & (high >= 2.0)))
    margin = 4.5 * np.sqrt(0.09 / 2000)
    assert abs(shares[0] - 0.90) < margin
    assert shares[1] < 0.90 - margin


def test_beer_says_when_light_is_lost_or_too_much() -> None:
    model = bench_model(10, MAPS)
    measured = through(model, 1.0, 0.002)
    value = measured.value.copy()
    value[:, 2, 2], value[:, 2, 4], value[0, 2, 6] = 0.001, 1.1, np.nan
    result = BeerEstimator(model).estimate(replace(measured, value=value))
    assert result.status[[2, 4]].tolist() == [Status.COLLIMATED_LOST, Status.CONTRADICTORY]
    assert np.isnan(result.sigma_t_per_mm[[2, 4]]).all()
    assert result.sample_status[0, 6] == Status.MASKED
    assert result.status[6] == Status.OK
    assert np.isnan(result.albedo).all()


def test_beer_masks_what_has_no_noise_and_says_which_sample_is_impossible() -> None:
    model = bench_model(10, MAPS)
    measured = through(model, 1.0, 0.002)
    value, covariance = measured.value.copy(), measured.covariance.copy()
    covariance[2], value[0, 2, 5], value[:, 2, 7] = np.nan, 1.3, -0.5
    result = BeerEstimator(model).estimate(replace(measured, value=value, covariance=covariance))
    expected = [Status.MASKED, Status.INCONSISTENT, Status.CONTRADICTORY]
    assert result.status[[2, 5, 7]].tolist() == expected
    assert np.isnan(result.sigma_t_per_mm[[2, 7]]).all()
    assert np.isfinite(result.sigma_t_per_mm[5])
    assert any("left out at 1 of 10 wavelengths" in message for message in result.messages)
    assert any("wavelengths masked" in message for message in result.messages)


def test_beer_notices_samples_of_different_material() -> None:
    model = bench_model(50, MAPS)
    measured = through(model, 1.0, 0.002)
    value = measured.value.copy()
    value[0, 2] *= 0.9
    result = BeerEstimator(model).estimate(replace(measured, value=value))
    assert (result.status == Status.INCONSISTENT).all()


def test_every_status_names_a_cause_and_a_remedy() -> None:
    for status in Status:
        assert status.cause.endswith(".")
        assert status.remedy.endswith(".")
        assert status.text == f"{status.cause} {status.remedy}"
    assert len({status.text for status in Status}) == len(Status)


def test_intervals_come_from_the_quantiles() -> None:
    result = lut_result()
    mean, error = np.array([[0.5, 2.0, 0.1]] * 12), np.array([[0.1, 0.2, 0.3]] * 12)
    gaussian = replace(result, quantile=gaussian_quantiles(mean, error))
    low, high = gaussian.interval(0.6827)
    np.testing.assert_allclose(high - low, 2 * error, rtol=1e-3)
    low, high = gaussian.interval(0.98)
    np.testing.assert_allclose(high - mean, 2.3263 * error, rtol=1e-3)
    with pytest.raises(ValueError, match="coverage"):
        gaussian.interval(0.999)
    assert result.counts()["masked"] == 1


def test_an_estimate_survives_its_file_and_gives_the_same_bytes(tmp_path: Path) -> None:
    result = lut_result()
    one = estimators.write_netcdf(result, tmp_path / "one.nc")
    two = estimators.write_netcdf(result, tmp_path / "two.nc")
    assert one.read_bytes() == two.read_bytes()
    back = estimators.read_netcdf(one)
    for name, value in vars(result).items():
        other = getattr(back, name)
        if isinstance(value, np.ndarray):
            assert value.dtype == other.dtype, name
            assert np.array_equal(value, other, equal_nan=value.dtype.kind == "f"), name
        else:
            assert value == other, name
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.nc", "two.nc"]


@given(st.data())
def test_a_damaged_file_is_refused(data: st.DataObject) -> None:
    import tempfile

    raw = _FILE.get("raw")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "estimate.nc"
        if raw is None:
            raw = estimators.write_netcdf(lut_result(), path).read_bytes()
            _FILE["raw"] = raw
        where = data.draw(st.integers(0, len(raw) - 1))
        change = data.draw(st.integers(1, 255))
        cut = data.draw(st.booleans())
        damaged = (
            raw[:where] if cut else bytes([*raw[:where], raw[where] ^ change, *raw[where + 1 :]])
        )
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"estimate\.nc"):
            estimators.read_netcdf(path)


_FILE: dict[str, bytes] = {}


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="writable"):
        estimators.write_netcdf(lut_result(), tmp_path / "nowhere" / "a.nc")
    with pytest.raises(InputError, match="no such file"):
        estimators.read_netcdf(tmp_path / "missing.nc")


def test_the_table_is_tidy(tmp_path: Path) -> None:
    result = replace(lut_result(), sample_names=('thin, "A"', "thick"))
    path = estimators.write_csv(result, tmp_path / "estimate.csv")
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12 * (3 + 2 * 8)
    assert {row["sample"] for row in rows} == {"", 'thin, "A"', "thick"}
    first = rows[1]
    assert first["quantity"] == "sigma_t_per_mm"
    assert float(first["value"]) == result.sigma_t_per_mm[0]
    assert float(first["standard_error"]) == result.standard_error[0, 1]
    masked = [row for row in rows if row["status"] == "masked" and row["sample"] == ""]
    assert len(masked) == 3
    assert all(row["value"] == "" for row in masked)


def test_estimators_are_made_by_name() -> None:
    model = bench_model(6, MAPS)
    assert {"lut", "lut-seed", "beer"} <= set(estimators.names())
    for name in ("lut", "lut-seed", "beer"):
        made = estimators.estimator(name, model)
        assert isinstance(made, Estimator)
        assert made.estimate(visit(model, materials(6), noise=0.01)).status.shape == (6,)
    assert estimators.estimator("lut", model, draws=0).settings.draws == 0  # type: ignore[attr-defined]


def test_an_unknown_name_or_option_is_refused() -> None:
    model = bench_model(3, MAPS)
    with pytest.raises(InputError, match='Did you mean "beer"'):
        estimators.estimator("bear", model)
    with pytest.raises(InputError, match="options"):
        estimators.estimator("lut", model, sample=3)


class _Point:
    """An entry point of another package."""

    name, value = "mine", "mine.fit:make"

    def __init__(self, made: object) -> None:
        self.made = made

    def load(self) -> object:
        if isinstance(self.made, Exception):
            raise self.made
        return lambda model: self.made


@pytest.mark.parametrize(
    ("made", "message"),
    [(ImportError("no module mine"), "cannot be loaded"), (3, "name and estimate")],
)
def test_a_broken_announced_estimator_is_refused(
    monkeypatch: pytest.MonkeyPatch, made: object, message: str
) -> None:
    monkeypatch.setattr(registry_module, "entry_points", lambda group: [_Point(made)])
    with pytest.raises(InputError, match=message):
        estimators.estimator("mine", bench_model(3, MAPS))


def test_an_announced_estimator_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    mine = BeerEstimator(bench_model(3, MAPS))
    monkeypatch.setattr(registry_module, "entry_points", lambda group: [_Point(mine)])
    assert "mine" in estimators.names()
    assert estimators.estimator("mine", bench_model(3, MAPS)) is mine


def test_the_quantile_levels_are_symmetric() -> None:
    np.testing.assert_allclose(QUANTILE_LEVELS + QUANTILE_LEVELS[::-1], 1.0)
