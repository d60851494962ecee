"""Parts of the report of a diagnosis: error bars, colours of captures, sentences without a gap."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis import Channel, Diagnosis, RankedEffect
from scenarios.report_diagnosis.colour import capture_rows
from scenarios.report_diagnosis.residual_plot import mean_residual
from scenarios.report_diagnosis.words import Named, headline, rare, where_sentences
from twin.spectra import FloatArray

WAVELENGTH = np.arange(400.0, 701.0, 10.0)


def test_error_bars_hold_what_is_common_to_all_wavelengths() -> None:
    """Against drawn noise; as the control, the independent part alone is too small."""
    random = np.random.Generator(np.random.Philox(key=4))
    root = random.standard_normal((5, 4, 4))
    common = random.standard_normal((2, 5, 4))
    valid = np.ones((5, 4), dtype=bool)
    valid[2, 1] = False
    draws = np.einsum("wmn,dwn->dwm", root, random.standard_normal((4000, 5, 4)))
    draws += np.einsum("kwm,dk->dwm", common, random.standard_normal((4000, 2)))
    own, predicted = [0, 1, 3], random.standard_normal((5, 4))

    def seen(value: FloatArray, common: FloatArray) -> tuple[FloatArray, FloatArray]:
        problem: Any = SimpleNamespace(
            valid=valid, value=value, independent=root @ root.transpose(0, 2, 1), common=common
        )
        return mean_residual(problem, predicted, own)

    found = np.array([seen(predicted + noise, common)[0] for noise in draws])
    _, sd = seen(predicted, common)
    assert sd == pytest.approx(found.std(axis=0), rel=0.06)
    _, alone = seen(predicted, common[:0])
    assert np.abs(alone / found.std(axis=0) - 1.0).max() > 0.2


def test_a_capture_has_its_colour_where_it_is_known() -> None:
    """Masked ends are left out of the sums, and not filled with the last value that is known."""
    random = np.random.Generator(np.random.Philox(key=5))
    value, before, after = random.uniform(0.2, 0.8, (3, WAVELENGTH.size, 1))

    def rows(cut: slice, valid: FloatArray) -> tuple[tuple[str, str, float, float], ...]:
        problem: Any = SimpleNamespace(
            blocks=(("black", "one"),), channels=(Channel("black", "one", 0),),
            wavelength_nm=WAVELENGTH[cut], value=value[cut], valid=valid[cut, None] > 0.0,
        )  # fmt: skip
        null, best = (SimpleNamespace(predicted=each[cut]) for each in (before, after))
        return capture_rows(problem, null, best)  # type: ignore[arg-type]

    ends = np.zeros(WAVELENGTH.size)
    ends[2:-2] = 1.0
    whole, masked, cut = (
        rows(slice(None), ends + 1.0), rows(slice(None), ends), rows(slice(2, -2), ends)
    )  # fmt: skip
    assert masked == cut
    assert masked[0][2:] != pytest.approx(whole[0][2:], rel=1e-3)
    assert rows(slice(5, -2), ends) == ()


def test_without_a_loud_block_the_sentence_can_follow_the_gap() -> None:
    said = where_sentences(Diagnosis(verdict="no_gap", reason=""))
    assert said == ["shows nowhere: no block is louder than noise"]


@pytest.mark.parametrize(
    ("probability", "words"),
    [(0.0304, "0.03"), (2.5e-6, "2.5e-06"), (6e-54, "< 1e-6"), (0.0, "< 1e-6")],
)
def test_tails_of_the_noise_get_no_number(probability: float, words: str) -> None:
    assert rare(probability) == words


def test_one_effect_is_named_with_its_own_probability_and_a_second_as_perhaps() -> None:
    """The best explanation may be a pair whose second member is not known to be there."""
    plain = Named({}, {}, {})
    sure, unsure = (
        RankedEffect(name, share, (), True, 0.0, 1e-6, 20.0)
        for name, share in (("thickness", 0.998), ("ambient_light", 0.47))
    )
    found = Diagnosis(
        verdict="effect", reason="one effect", effects=(sure, unsure),
        leading=("ambient_light", "thickness"),
    )  # fmt: skip
    assert headline(found, plain) == (
        "One effect makes the gap, with > 99 % probability: thickness ();"
        " perhaps also, with 47 %: ambient_light ()."
    )
    alone = headline(replace(found, leading=("thickness",)), plain)
    assert alone == "One effect makes the gap, with > 99 % probability: thickness ()."
