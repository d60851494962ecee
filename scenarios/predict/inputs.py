"""What a person types for `benchtwin predict`, as values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.predict.mixture import checked_fractions
from twin.errors import InputError
from twin.spectra import Spectral

if TYPE_CHECKING:
    from scenarios.predict.appearance import Slab
    from scenarios.predict.mixture import UncertainMedium


def slab_of(thickness_mm: float, n: str, background: str) -> Slab:
    """The slab of what was typed; "black" and "white" are the bench's own backgrounds.

    Raises:
        InputError: a thickness of 0 or less, a number out of range, an unknown name.
    """
    from scenarios.predict.appearance import Slab
    from twin.bench import Backgrounds
    from twin.materials import reflectance, refractive_index

    bench = Backgrounds()
    named: dict[str, Spectral] = {
        "black": bench.black.reflectance, "white": bench.white.reflectance,
    }  # fmt: skip
    slab = Slab(
        thickness_mm, _number_or_name(n), named.get(background, _number_or_name(background))
    )
    middle = np.array([550.0])
    for place, look_up, value in (
        ("--n", refractive_index, slab.n), ("--background", reflectance, slab.background),
    ):  # fmt: skip
        try:
            look_up(value, middle)
        except InputError as error:
            raise error.at(error.file, place) from error
    return slab


def _number_or_name(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def illuminants_of(names: Sequence[str]) -> list[str]:
    """Illuminants that exist; "none" is no colour at all.

    Raises:
        InputError: an illuminant that the library does not know.
    """
    from twin.materials import lamp

    wanted = [name for name in dict.fromkeys(names) if name != "none"]
    for name in wanted:
        try:
            lamp(name, np.array([550.0]))
        except InputError as error:
            raise error.at(error.file, "--illuminant") from error
    return wanted


def medium_from(estimates: Sequence[str], mix: bool, draws: int, seed: int) -> UncertainMedium:
    """The one estimate, or the mixture of those typed as FILE:FRACTION.

    Raises:
        InputError: not one estimate, a part without a fraction, fractions that do not add to 1.
    """
    from scenarios.predict.mixture import mix_media

    if not mix:
        if len(estimates) != 1:
            raise InputError(
                f"{len(estimates)} estimates", "one, or several with --mix FILE:FRACTION ...",
                remedy="To compare two, name the second with --compare.",
            )  # fmt: skip
        return read_medium(Path(estimates[0]), draws, seed)
    paths, fractions = [], []
    for text in estimates:
        path, _, fraction = text.rpartition(":")
        try:
            fractions.append(float(fraction))
        except ValueError as error:
            raise InputError(
                f'"{text}"', "a file and its volume fraction, such as cyan/result.nc:0.3",
                place="--mix",
            ) from error  # fmt: skip
        paths.append(Path(path))
    checked_fractions(fractions, len(paths))
    # a file that is named twice is one material: its error does not average out
    media = {
        path: read_medium(path, draws, seed + number)
        for number, path in enumerate(dict.fromkeys(paths))
    }
    return mix_media([media[path] for path in paths], fractions)


def read_medium(path: Path, draws: int, seed: int) -> UncertainMedium:
    """The medium of an estimate on disk, named after its file, or its folder if it is result.nc.

    Raises:
        InputError: a file that is no estimate, or one without a usable wavelength.
    """
    from estimators import read_netcdf
    from scenarios.predict.draws import medium_of

    name = path.resolve().parent.name if path.stem == "result" else path.stem
    result = read_netcdf(path)
    try:
        return medium_of(result, count=draws, seed=seed, name=name)
    except InputError as error:
        raise error.at(path) from error
