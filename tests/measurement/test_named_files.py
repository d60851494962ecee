"""A folder of exported spectra whose names say what they are."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from twin.errors import InputError
from twin.measurement import Measurement, Shot, read_measurement, relative_intensities

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "hand_made"
PATTERN = 'pattern = ["{sample}_{capture}_{repeat}.txt", "{capture}_{repeat}.txt"]\n'
OCEANVIEW = """Data from here Node

Date: Mon Jul 27 14:{minute:02d}:{second:02d} CEST 2015
Integration Time (sec): {time:E}
Scans to average: {averages}
Electric dark correction enabled: false
Nonlinearity correction enabled: false
Boxcar width: 0
Number of Pixels in Spectrum: {pixels}
>>>>>Begin Spectral Data<<<<<
{table}
"""


def oceanview(shot: Shot, wavelength: np.ndarray, counts: np.ndarray) -> str:
    seconds = int(shot.time_s)
    pixels = zip(wavelength, map(float, counts), strict=True)
    return OCEANVIEW.format(
        minute=seconds // 60, second=seconds % 60, time=shot.integration_s, averages=shot.averages,
        pixels=wavelength.size,
        table="\n".join(f"{w:.3f}\t{c!r}" for w, c in pixels),
    )  # fmt: skip


def jcamp(shot: Shot, wavelength: np.ndarray, counts: np.ndarray) -> str:
    rows = "\n".join(f"{w}, {c!r}" for w, c in zip(wavelength, counts.tolist(), strict=True))
    return (
        "##TITLE= s\n##XUNITS= NANOMETERS\n##YUNITS= COUNTS\n##XFACTOR= 1\n##YFACTOR= 1\n"
        f"##.ACQUISITION TIME= {1000 * shot.integration_s:g}\n##.AVERAGES= {shot.averages}\n"
        f"##NPOINTS= {wavelength.size}\n##XYPOINTS= (XY..XY)\n{rows}\n##END=\n"
    )


def exported(folder: Path, write=oceanview, ending: str = ".txt") -> Path:
    """The documented example as one file for each spectrum."""
    captures = read_measurement(EXAMPLE).captures
    assert captures is not None
    folder.mkdir()
    for name in ("bench.toml", "samples.csv"):
        shutil.copy(EXAMPLE / name, folder)
    numbers: dict[tuple[str, str], int] = {}
    for shot, counts in zip(captures.shots, captures.counts, strict=True):
        key = (shot.capture, shot.sample)
        number = numbers[key] = numbers.get(key, -1) + 1
        name = "_".join(part for part in (shot.sample, shot.capture, str(number)) if part)
        text = write(shot, captures.wavelength_nm, counts)
        (folder / (name + ending)).write_text(text)
    (folder / "files.toml").write_text(PATTERN.replace(".txt", ending))
    return folder


def table_of(measurement: Measurement) -> dict[tuple[str, str, float, float], list[float]]:
    captures = measurement.captures
    assert captures is not None
    return {
        (s.capture, s.sample, s.time_s, s.integration_s): counts.tolist()
        for s, counts in zip(captures.shots, captures.counts, strict=True)
    }


def test_a_folder_of_exports_is_the_measurement_of_its_table(tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit")
    (folder / "photo.jpg").write_bytes(b"of the bench")
    found, expected = read_measurement(folder), read_measurement(EXAMPLE)
    assert table_of(found) == table_of(expected)
    times = [shot.time_s for shot in found.captures.shots]
    assert times == sorted(times)
    assert found.samples == expected.samples
    assert found.provenance.origin == "handmade"
    one, other = relative_intensities(found), relative_intensities(expected)
    np.testing.assert_allclose(one.value, other.value, rtol=1e-12)


def test_jcamp_files_need_the_unit_of_their_time(tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit", jcamp, ".jdx")
    with pytest.raises(InputError, match=r"without a unit; expected integration_unit = \"ms\""):
        read_measurement(folder)
    with (folder / "files.toml").open("a") as file:
        file.write('integration_unit = "ms"\n')
    found, expected = read_measurement(folder), read_measurement(EXAMPLE)
    assert {key[:2] + key[3:] for key in table_of(found)} == {
        key[:2] + key[3:] for key in table_of(expected)
    }
    assert any("the order of their names" in note for note in found.provenance.notes)
    for path in folder.glob("*.jdx"):
        path.write_text(path.read_text().replace("COUNTS", "Transmission (%)"))
    with pytest.raises(InputError, match=r"YUNITS= Transmission \(%\); expected COUNTS"):
        read_measurement(folder)


def test_other_names_for_samples_and_captures(tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit")
    for path in folder.glob("*.txt"):
        name = path.name.replace("teal-thin", "A").replace("teal-thick", "B")
        for long, short in (("white_reference", "W"), ("beam_reference", "LED"), ("dark", "D")):
            name = name.replace(long, short)
        path.rename(path.with_name(f"2015 {name}"))
    (folder / "files.toml").write_text(
        'pattern = ["* {sample}_{capture}_{repeat}.txt", "* {capture}_{repeat}.txt"]\n'
        'samples = { A = "teal-thin", B = "teal-thick" }\n'
        'captures = { W = "white_reference", LED = "beam_reference", D = "dark" }\n'
    )
    assert table_of(read_measurement(folder)) == table_of(read_measurement(EXAMPLE))


def _rename(old: str, new: str):
    return lambda folder: (folder / old).rename(folder / new)


def _edit(name: str, old: str, new: str):
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))

    return change


def _copy(old: str, new: str):
    return lambda folder: shutil.copy(folder / old, folder / new)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_rename("teal-thin_black_0.txt", "teal-thim_black_0.txt"),
         "teal-thim_black_0.txt: found a name with the sample 'teal-thim'; expected one of"
         " teal-thin, teal-thick. Did you mean `teal-thin`?"),
        (_rename("teal-thin_black_0.txt", "teal-thin_blakc_0.txt"),
         "teal-thin_blakc_0.txt: found a name with the capture 'blakc'"),
        (_rename("teal-thin_black_0.txt", "notes.txt"),
         "notes.txt: found a name that does not fit; expected {sample}_{capture}_{repeat}.txt or"),
        (_rename("teal-thin_black_0.txt", "teal-thin_black_3.txt"),
         "found no repeat 2 of black of 'teal-thin', though there is teal-thin_black_3.txt"),
        (_copy("teal-thin_black_0.txt", "teal-thin_black_00.txt"),
         "repeat 0: teal-thin_black_0.txt and teal-thin_black_00.txt; expected one of them"),
        (lambda folder: [path.unlink() for path in folder.glob("teal-thin_coll*")],
         "no file for collimated of 'teal-thin'; expected one named like"
         " teal-thin_collimated_0.txt"),
        (lambda folder: [path.unlink() for path in folder.glob("*dark*")],
         "no file for any dark; expected one named like teal-thin_dark_0.txt"),
        (lambda folder: [path.unlink() for path in folder.glob("*.txt")],
         "found no spectrum; expected files named"),
        (_edit("teal-thin_black_0.txt", "400.000", "400.100"),
         "teal-thin_black_0.txt: found 16 wavelengths from 400.1 to 700 nm; expected those of"
         " "),
        (_edit("teal-thin_black_0.txt", "Boxcar width: 0", "Boxcar width: 5"),
         "teal-thin_black_0.txt: found boxcar width: 5; expected 0, as in"),
        (_edit("teal-thin_black_0.txt", "Begin Spectral", "Begin"),
         "teal-thin_black_0.txt: found no line >>>>>Begin"),
        (_edit("files.toml", "{sample}", "{smaple}"), "found the placeholder {smaple}"),
        (_edit("files.toml", "{capture}", "capture"), "expected {capture} in it"),
        (_edit("files.toml", "{repeat}.txt", "{repeat}"), "with an ending such as .txt"),
        (_edit("files.toml", "pattern", "patern"), "Did you mean `pattern`?"),
        (lambda folder: shutil.copy(EXAMPLE / "captures.csv", folder),
         "found captures.csv and files.toml; expected one of them"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)  # fmt: skip
def test_mistakes_are_answered_by_name(change, message: str, tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit")
    change(folder)
    with pytest.raises(InputError) as caught:
        read_measurement(folder)
    assert message in str(caught.value)


def test_a_name_that_can_mean_two_things_is_refused(tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit")
    (folder / "samples.csv").write_text("name,thickness_mm\na,0.5\na_white,1\n")
    (folder / "files.toml").write_text(
        'pattern = "{sample}_{capture}_{repeat}.txt"\ncaptures = { white_black = "black" }\n'
    )
    for path in folder.glob("*.txt"):
        path.unlink()
    (folder / "a_white_black_0.txt").write_text("")
    with pytest.raises(InputError) as caught:
        read_measurement(folder)
    assert "a_white_black_0.txt: found a name that can mean black of 'a', repeat 0 or black of" in (
        str(caught.value)
    )


def test_the_time_in_the_name_must_be_that_of_the_head(tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit")
    for path in folder.glob("*.txt"):
        head = path.read_text()
        time = float(head.split("(sec): ")[1].split()[0])
        path.rename(path.with_name(f"{1000 * time:g}ms_{path.name}"))
    (folder / "files.toml").write_text(PATTERN.replace('"{', '"{integration_ms}ms_{'))
    assert table_of(read_measurement(folder)) == table_of(read_measurement(EXAMPLE))
    path = next(folder.glob("*teal-thin_black_0.txt"))
    path.rename(path.with_name("77ms_teal-thin_black_0.txt"))
    with pytest.raises(InputError, match=r"0\.077 s in its name and .* s in its head"):
        read_measurement(folder)


def test_counts_that_were_linearised_are_not_linearised_again(tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit")
    for path in folder.glob("*.txt"):
        path.write_text(path.read_text().replace("rity correction enabled: false",
                                                 "rity correction enabled: true"))  # fmt: skip
    read_measurement(folder)  # an instrument that is not described is not linearised
    with (folder / "bench.toml").open("a") as file:
        file.write("[instrument]\nnonlinearity = -0.01\n")
    with pytest.raises(InputError, match='off = \\["nonlinearity"\\]'):
        read_measurement(folder)


def test_ignored_files(tmp_path: Path) -> None:
    folder = exported(tmp_path / "visit")
    (folder / "notes.txt").write_text("rain")
    with (folder / "files.toml").open("a") as file:
        file.write('ignore = ["notes.txt"]\n')
    assert table_of(read_measurement(folder)) == table_of(read_measurement(EXAMPLE))
