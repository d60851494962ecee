from __future__ import annotations

import tomllib
from itertools import pairwise
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from twin.bench import Bench
from twin.instrument import Instrument, MultispectralChip, Spectrometer
from twin.spectra import SpectralTable

DOCS = Path(__file__).parents[2] / "docs" / "instrument.md"


def test_the_default_grid_runs_from_400_to_700_nm() -> None:
    wavelength = Spectrometer().wavelength_nm
    assert (wavelength[0], wavelength[-1], len(wavelength)) == (400.0, 700.0, 151)


@pytest.mark.parametrize(("step", "count"), [(0.1, 3001), (0.3, 1001), (7.0, 43), (400.0, 1)])
def test_a_grid_never_passes_its_stop(step: float, count: int) -> None:
    wavelength = Spectrometer(step_nm=step).wavelength_nm
    assert len(wavelength) == count
    assert wavelength[-1] <= 700.0 + 1e-9


def test_explicit_pixels_replace_the_grid() -> None:
    assert Spectrometer(pixels_nm=(450.0, 451.5, 454.0)).wavelength_nm == (450.0, 451.5, 454.0)


@pytest.mark.parametrize(
    ("atime", "astep", "full_scale"),
    [(0, 0, 1), (0, 999, 1000), (99, 999, 65535), (9, 3596, 35970), (255, 65534, 65535)],
)
def test_full_scale_of_the_chip(atime: int, astep: int, full_scale: int) -> None:
    chip = MultispectralChip(atime=atime, astep=astep, dark_level_counts=0.0)
    assert chip.full_scale_counts == full_scale
    assert chip.integration_s == pytest.approx((atime + 1) * (astep + 1) * 2.78e-6)


def test_gain_divides_the_electrons_per_count() -> None:
    low, high = MultispectralChip(gain=4.0), MultispectralChip(gain=64.0)
    assert low.electrons_per_count == pytest.approx(16 * high.electrons_per_count)


def test_the_chip_has_the_published_bands() -> None:
    chip = MultispectralChip()
    assert chip.wavelength_nm == (415, 445, 480, 515, 555, 590, 630, 680)
    assert all(b > a for a, b in pairwise(chip.wavelength_nm))
    assert chip.fwhm_nm == (26, 30, 36, 39, 39, 40, 50, 52)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"step_nm": 0.0}, "step_nm"),
        ({"stop_nm": 300.0}, "increases"),
        ({"step_nm": 1e-6}, "20000"),
        ({"pixels_nm": (500.0, 500.0)}, "increase"),
        ({"pixels_nm": ()}, "one or more"),
        ({"pixels_nm": (-1.0, 500.0)}, "above 0"),
        ({"shortest_s": 2.0, "longest_s": 1.0}, "longest"),
        ({"adc_bits": 10}, "full scale"),
        ({"off": ("read_noise", "read_noise")}, "once"),
        ({"off": ("readnoise",)}, "read_noise"),
        ({"responsivity": 0.0}, "above 0"),
        ({"read_noise": 3.0}, "read_noise"),
        ({"kind": "chip", "gain": 3.0}, "512"),
        ({"kind": "chip", "range_nm": (500.0, 700.0)}, "F1"),
        ({"kind": "chip", "atime": 0, "astep": 0}, "full scale"),
        ({"kind": "chip", "channels": ()}, "channels"),
        ({"kind": "camera"}, "camera"),
    ],
)
def test_a_wrong_description_is_refused_with_a_reason(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        Bench.model_validate({"instrument": {"kind": "spectrometer", **wrong}})


def test_a_response_table_must_cover_the_range() -> None:
    table = SpectralTable(wavelength_nm=(400.0, 500.0), value=(0.0, 1.0))
    channel = {"name": "X", "centre_nm": 450.0, "fwhm_nm": 20.0, "response": table}
    with pytest.raises(ValidationError, match="cover"):
        MultispectralChip.model_validate({"channels": (channel,)})


def test_the_examples_in_the_documentation_load() -> None:
    blocks = DOCS.read_text(encoding="utf-8").split("```toml\n")[1:]
    adapter: TypeAdapter[Instrument] = TypeAdapter(Instrument)
    kinds = {
        adapter.validate_python(tomllib.loads(block.split("```")[0])["instrument"]).kind
        for block in blocks
    }
    assert kinds == {"spectrometer", "chip"}


def test_every_parameter_is_documented() -> None:
    text = DOCS.read_text(encoding="utf-8")
    names = {*Spectrometer.model_fields, *MultispectralChip.model_fields}
    assert not [name for name in sorted(names) if f"`{name}`" not in text]
