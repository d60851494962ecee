"""OceanView and SpectraSuite exports, in both notations of numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.measurement.visits import answer_of
from twin.errors import InputError
from twin.measurement import read_oceanview

OCEANVIEW = """Data from QE65_00001.txt Node

Date: Mon Jul 27 14:20:36 CEST 2015
User: lab
Spectrometer: QEPB0123
Trigger mode: 0
Integration Time (sec): 1.250000E-1
Scans to average: 10
Electric dark correction enabled: true
Nonlinearity correction enabled: false
Boxcar width: 2
XAxis mode: Wavelengths
Number of Pixels in Spectrum: 3
>>>>>Begin Spectral Data<<<<<
339.044\t-31.53
339.424\t1002.5
339.805\t65535
"""
SPECTRASUITE = """SpectraSuite Data File
++++++++++++++++++++++++++++++++++++
Date: Thu Jun 11 10:00:00 CEST 2015
Integration Time (usec): 125000 (USB2G1234)
Spectra Averaged: 10 (USB2G1234)
Boxcar Smoothing: 2 (USB2G1234)
Correct for Electrical Dark: Yes (USB2G1234)
Correct for Detector Non-linearity: No (USB2G1234)
Number of Pixels in Processed Spectrum: 3
>>>>>Begin Processed Spectral Data<<<<<
339.044\t-31.53
339.424\t1002.5
339.805\t65535
>>>>>End Processed Spectral Data<<<<<
"""


@pytest.mark.parametrize("text", [OCEANVIEW, SPECTRASUITE])
@pytest.mark.parametrize("comma", [False, True])
def test_both_programs_and_notations(text: str, comma: bool, tmp_path: Path) -> None:
    head, mark, data = text.partition(">>>>>Begin")
    head = head.replace("1.250000E-1", "1,250000E-1") if comma else head
    path = tmp_path / "spectrum.txt"
    path.write_bytes((head + mark + (data.replace(".", ",") if comma else data)).encode("latin-1"))
    wavelength, counts, settings = read_oceanview(path)
    np.testing.assert_array_equal(wavelength, [339.044, 339.424, 339.805])
    np.testing.assert_array_equal(counts, [-31.53, 1002.5, 65535])
    assert settings.integration_s == pytest.approx(0.125)
    assert settings.averages == 10
    assert settings.boxcar == 2
    assert settings.dark_corrected
    assert not settings.nonlinearity_corrected


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (">>>>>Begin Spectral Data<<<<<", "", "no line >>>>>Begin"),
        ("Integration Time (sec): 1.250000E-1\n", "", "no integration time"),
        ("339.805\t65535\n", "", "found 2 pixels; expected 3"),
        ("339.805\t65535", "339.805\tNaN", "line 17: found '339.805\\tNaN'"),
        ("339.805\t65535", "339.805", "line 17"),
        ("339.805", "339.4", "339.4 nm after 339.424 nm"),
    ],
)
def test_mistakes(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "spectrum.txt"
    assert old in OCEANVIEW
    path.write_text(OCEANVIEW.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_oceanview(path)
    assert message in str(caught.value)
    assert caught.value.file == str(path)


@given(data=st.data())
def test_any_bytes(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    content = bytearray(OCEANVIEW.encode())
    for _ in range(data.draw(st.integers(0, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    path = tmp_path_factory.mktemp("ocean") / "spectrum.txt"
    path.write_bytes(bytes(content))
    answer, error = answer_of(lambda: read_oceanview(path))
    if error is not None:
        assert error.file == str(path)
    else:
        assert answer is not None
        wavelength, counts, settings = answer
        assert wavelength.shape == counts.shape
        assert np.all(np.diff(wavelength) > 0)
        assert np.isfinite(counts).all()
        assert settings.integration_s > 0
