"""`benchtwin predict` as a person calls it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from estimators import Status, write_netcdf
from scenarios.cli import guarded
from scenarios.predict import read_pbrt
from scenarios.predict.command import register
from tests.predict.estimates import WAVELENGTH, constant, estimate

app = typer.Typer()


@app.callback()
def _several() -> None:
    """With a callback typer keeps the name of a single command."""


register(app, guarded)


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["predict", "--quiet", *(str(part) for part in arguments)])


def answer(result: Result) -> dict[str, Any]:
    assert result.exit_code == 0, result.stderr
    found: dict[str, Any] = json.loads(result.stdout)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("predict")
    small = (0.005, 0.01, 0.02)
    write_netcdf(estimate(constant(0.9, 5.0, 0.4), small), base / "light.nc")
    write_netcdf(estimate(constant(0.4, 3.0, 0.2), small), base / "dark.nc")
    status = np.full(len(WAVELENGTH), Status.OK)
    status[2:5] = Status.OUTSIDE_MAP
    write_netcdf(estimate(constant(0.4, 3.0, 0.2), small, status=status), base / "holed.nc")
    return base


def test_a_prediction_is_answered_and_written(folder: Path, tmp_path: Path) -> None:
    arguments = (
        folder / "light.nc", "--thickness", 2, "--background", "white", "--draws", 40,
        "--illuminant", "D65", "--illuminant", "A", "--json", "--out",
    )  # fmt: skip
    found = answer(call(*arguments, tmp_path / "one"))
    assert [row["illuminant"] for row in found["colours"]] == ["D65", "A"]
    first = found["colours"][0]
    for lower, value, upper in zip(
        first["lab_lower_90"], first["lab"], first["lab_upper_90"], strict=True
    ):
        assert lower - 0.2 < value < upper + 0.2
    assert "independent and common" in found["wavelengths_go_together"]
    rows = (tmp_path / "one" / "prediction.csv").read_text().splitlines()
    assert len(rows) == 1 + len(WAVELENGTH)
    assert json.loads((tmp_path / "one" / "summary.json").read_text())["medium"] == "light"
    answer(call(*arguments, tmp_path / "two"))
    for name in ("prediction.csv",):
        same = [(tmp_path / which / name).read_bytes() for which in ("one", "two")]
        assert same[0] == same[1]


def test_the_example_of_the_page_runs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "prediction.md").read_text(encoding="utf-8")
    example = page.split("```python")[1].split("```")[0]
    names: dict[str, Any] = {}
    exec(compile(example, "prediction.md", "exec"), names)  # noqa: S102 - our own page
    assert names["colour"].illuminant == "FL4"


def test_a_mixture_is_written_as_a_medium(folder: Path, tmp_path: Path) -> None:
    found = answer(
        call(
            "--mix", f"{folder / 'light.nc'}:0.3", f"{folder / 'dark.nc'}:0.7", "--draws", 20,
            "--export", "pbrt", "--unit", 10, "--json", "--out", tmp_path,
        )
    )  # fmt: skip
    assert found["medium"] == "30 % light + 70 % dark"
    medium = read_pbrt(tmp_path / "medium.pbrt")
    np.testing.assert_allclose(medium.sigma_t_per_mm, 0.3 * 5 + 0.7 * 3)
    np.testing.assert_allclose(medium.albedo, (0.3 * 4.5 + 0.7 * 1.2) / 3.6)
    assert medium.unit_mm == 10.0


def test_a_comparison_gives_differences(folder: Path, tmp_path: Path) -> None:
    light, dark = folder / "light.nc", folder / "dark.nc"
    options = ("--draws", 40, "--thickness", "inf", "--json", "--out", tmp_path)
    (row,) = answer(call(light, "--compare", dark, *options))["differences"]
    assert row["interval_90"][0] < row["ciede2000"] < row["interval_90"][1]
    assert row["ciede2000"] > 10
    (same,) = answer(call(light, "--compare", light, *options))["differences"]
    assert same["ciede2000"] == 0.0


def test_unknown_wavelengths_refuse_a_colour_but_not_a_reflectance(
    folder: Path, tmp_path: Path
) -> None:
    holed = folder / "holed.nc"
    refused = call(holed, "--draws", 20, "--out", tmp_path)
    assert refused.exit_code == 2
    assert "3 of 7 visible wavelengths without a value" in refused.stderr
    assert "outside_map" in refused.stderr
    assert list(tmp_path.iterdir()) == []
    found = answer(call(holed, "--draws", 20, "--illuminant", "none", "--json", "--out", tmp_path))
    assert found["colours"] == []
    assert found["predicted_at"] == 4
    assert "3 of 7 wavelengths have no usable estimate" in found["notes"][0]


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        ((), "found 0 estimates"),
        (("light.nc", "dark.nc"), "found 2 estimates"),
        (("--mix", "light.nc:0.5", "dark.nc:0.4"), "add up to 0.9"),
        (("--mix", "light.nc", "dark.nc:1"), "a file and its volume fraction"),
        (("nowhere.nc",), "no such file"),
        (("light.nc", "--thickness", "0"), "thickness of 0 mm"),
        (("light.nc", "--thickness", "nan"), "thickness of nan mm"),
        (("light.nc", "--background", "velvet"), "--background"),
        (("light.nc", "--background", "1.2"), "--background"),
        (("light.nc", "--n", "0.5"), "--n"),
        (("light.nc", "--illuminant", "D56"), "--illuminant"),
        (("light.nc", "--engine", "magic"), "--engine"),
        (("light.nc", "--export", "blender"), "--export"),
        (("light.nc", "--export", "pbrt", "--unit", "0", "--draws", "20"), "unit of 0 mm"),
        (("light.nc", "--draws", "1"), "found 1 draws"),
        (("light.nc", "--missing", "1"), "--missing"),
        (("light.nc", "--engine", "monte-carlo", "--thickness", "inf"), "infinite thickness"),
        (("--checker", "light.nc"), "--checker alone"),
        (("--checker", "--thickness", "inf"), "infinite checker"),
        (("--checker", "--illuminant", "A", "--illuminant", "D65"), "2 illuminants"),
    ],
)
def test_wrong_input_gets_one_message_and_leaves_no_file(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    found: str,
) -> None:
    monkeypatch.chdir(folder)
    result = call(*arguments, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.stderr
    assert found in result.stderr
    assert "Traceback" not in result.stderr
    written = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert written == []
