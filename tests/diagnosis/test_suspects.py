"""Entries of a catalogue that can be judged, and the others with their reasons."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from diagnosis import Channel, Problem, Reduction
from diagnosis.response_noise import (
    LOUD_NOISE,
    MOST_TIMES,
    TOLD_FROM_NOISE,
    Loudness,
    loudness,
)
from diagnosis.suspects import Judgeable, candidate_of, judgeable
from twin.effects import Candidate, Effect, EffectParameter, LeftOut
from twin.spectra import FloatArray

W, S, R = 6, 2, 3
PLACE = np.tile(np.arange(3 * S), R)
"""Sample and capture of each of the R repeats' channels."""
SD = 0.01
SCALE = 0.5
MATERIAL = np.tile([0.9, 2.0, 0.6], (W, 1))
SIZE = W * 3 * S * R


def suspect(engine: str = "monte_carlo", name: str = "haze") -> Candidate:
    return Candidate(
        Effect(
            name, "sample", name, "none", "this test",
            (EffectParameter("amount", "1", 0.0, SCALE, limit=2.0),),
            engine, lambda world, values, instance: world,  # type: ignore[arg-type]
        )
    )  # fmt: skip


@dataclass
class Known:
    """An engine that knows every response as well as it is told, and counts who asks."""

    error: FloatArray
    asked: list[str] = field(default_factory=list)

    def signature_error(self, candidate: Candidate, material: FloatArray) -> FloatArray:
        assert material is MATERIAL
        self.asked.append(candidate.name)
        return self.error


def reduction(slope: FloatArray | None = None) -> Reduction:
    """Of data with a standard deviation of `SD`, and a material of slopes (W, M, P)."""
    shape = (W, PLACE.size)
    if slope is None:
        slope = np.zeros((*shape, 0))
    problem = Problem(
        wavelength_nm=np.linspace(400.0, 700.0, W),
        channels=tuple(
            Channel(capture, sample, repeat)
            for repeat in range(R) for sample in "ab" for capture in ("black", "white", "beam")
        ),
        value=np.zeros(shape), valid=np.ones(shape, dtype=bool),
        independent=np.broadcast_to(SD**2 * np.eye(shape[1]), (W, shape[1], shape[1])),
        common=np.zeros((0, *shape)), material=np.zeros((W, slope.shape[2])),
        forward=lambda material, values: np.zeros(shape),
        jacobian=lambda material, values: slope,
        signatures=np.zeros((0, *shape)), candidates=(),
    )  # fmt: skip
    return Reduction.of(problem, slope)


def of_loudness(sigma: float) -> FloatArray:
    """The same number in every datum, which are so many standard deviations in all, (1, W, M)."""
    return np.full((1, W, PLACE.size), sigma * SD / (SCALE * np.sqrt(SIZE)))


def doubt(signal: float, noise: float, slope: FloatArray | None = None) -> str:
    engine = Known(of_loudness(noise)[..., : 3 * S].reshape(1, W, S, 3))
    signature = of_loudness(signal)
    heard = loudness(engine, suspect(), MATERIAL, signature, PLACE, reduction(slope))
    return heard.doubt(64)


def test_a_response_that_is_mostly_noise_is_doubted_in_numbers() -> None:
    said = doubt(signal=12.0, noise=10.0)
    assert said.startswith("its response is not known well enough: 12.0 sigma for one prior scale")
    assert said.endswith("may be noise of the 64 light paths")
    stated = float(said.split("of which ")[1].split(" ")[0])
    # chi-square of 4 draws of W S 3 independent numbers, four standard errors
    assert stated == pytest.approx(10.0, rel=2.0 * np.sqrt(2.0 / (4 * W * S * 3)))


def test_a_response_that_is_well_known_is_not_doubted() -> None:
    assert doubt(signal=12.0, noise=0.0) == ""
    assert doubt(signal=2.0 * TOLD_FROM_NOISE * 10.0, noise=10.0) == ""
    assert doubt(signal=0.6 * TOLD_FROM_NOISE * 10.0, noise=10.0) != ""


def test_noise_that_the_data_cannot_see_does_no_harm() -> None:
    assert doubt(signal=0.1, noise=0.5 * LOUD_NOISE) == ""
    assert doubt(signal=0.1, noise=2.0 * LOUD_NOISE) != ""


def test_noise_that_the_material_takes_up_does_no_harm() -> None:
    # one unknown for each sample and capture, which all repeats share: nothing is left
    everything = np.broadcast_to(np.eye(3 * S)[PLACE], (W, PLACE.size, 3 * S))
    assert doubt(signal=12.0, noise=10.0, slope=everything) == ""
    half = everything.copy()
    half[:, :, 3:] = 0.0
    assert doubt(signal=12.0, noise=10.0, slope=half) != ""


@pytest.mark.parametrize(
    ("signal", "noise", "times"),
    [
        (12.0, 0.9, 1),  # harmless
        (40.0, 2.0, 1),  # well known
        (np.hypot(8.0, 3.0), 3.0, 4),  # 3 / sqrt(4) is below a quarter of the 8 that are true
        (np.hypot(8.0, 8.0), 8.0, MOST_TIMES),  # not well known even so, but told from noise
        (1.0, 2.5, MOST_TIMES),  # harmless with as many
        (60.0, 60.0, MOST_TIMES),  # as much may be true as is noise
        (np.inf, 0.0, 1),  # not the Monte Carlo's
    ],
)
def test_paths_are_asked_for_where_they_help(signal: float, noise: float, times: int) -> None:
    found = Loudness(signal, noise)
    assert found.times_wanted == times
    assert Loudness(signal, noise / np.sqrt(times)).sure or signal < noise


def test_no_paths_are_spent_on_a_response_that_stays_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("diagnosis.response_noise.MOST_TIMES", 2)
    assert Loudness(60.0, 60.0).times_wanted == 1
    assert Loudness(2.0, 2.5).times_wanted == 1
    assert Loudness(np.nan, 1.0).times_wanted == 1, "what is no number is said elsewhere"


def test_repeats_share_the_noise_of_their_response() -> None:
    """What differs between repeats is no noise of a response: a material of that kind is no use."""
    between = np.zeros((W, PLACE.size, R - 1))
    for repeat in range(1, R):
        between[:, : 3 * S, repeat - 1] = -1.0
        between[:, 3 * S * repeat : 3 * S * (repeat + 1), repeat - 1] = 1.0
    assert doubt(signal=12.0, noise=10.0, slope=between) == doubt(signal=12.0, noise=10.0)


def test_only_responses_of_the_monte_carlo_are_asked_for_their_noise() -> None:
    engine = Known(np.full((1, W, S, 3), 1e3))
    for kind in ("plane", "signal"):
        found = loudness(engine, suspect(kind), MATERIAL, of_loudness(0.1), PLACE, reduction())
        assert found.doubt(64) == ""
    assert engine.asked == []
    noisy = loudness(engine, suspect(), MATERIAL, of_loudness(0.1), PLACE, reduction())
    assert "not known well enough" in noisy.doubt(64)
    assert engine.asked == ["haze"]


def test_suspects_that_cannot_be_judged_are_named_and_the_rest_goes_on() -> None:
    answers = {
        "good": of_loudness(9.0),
        "nothing": of_loudness(0.0),
        "no number": np.where(PLACE == 1, np.nan, of_loudness(9.0)),
        "noisy": of_loudness(3.0),
        "also good": of_loudness(2.0),
    }

    def signature(each: Candidate) -> FloatArray:
        return answers[each.name]

    names = ("good", "raises", "nothing", "no number", "noisy", "also good")
    suspects = [suspect(name=name) for name in names]
    said: list[str] = []
    steps: list[tuple[float, float]] = []
    found = judgeable(
        suspects, signature, (W, PLACE.size),
        left_out=[LeftOut("absent", "cannot be loaded")],
        doubt=lambda each, own: "mostly noise" if each.name == "noisy" else "",
        say=said.append, progress=lambda done, total: steps.append((done, total)),
    )  # fmt: skip
    assert [each.name for each in found.suspects] == ["good", "also good"]
    np.testing.assert_array_equal(
        found.signatures, np.concatenate([answers["good"], answers["also good"]])
    )
    reasons = {each.name: each.reason for each in found.left_out}
    assert list(reasons) == ["absent", "raises", "nothing", "no number", "noisy"]
    assert reasons["raises"].startswith("KeyError")
    assert reasons["nothing"] == "changes nothing in these data"
    assert reasons["no number"] == "gives values that are no numbers"
    assert reasons["noisy"] == "mostly noise"
    assert said == [f"left out: {name}: {reason}" for name, reason in reasons.items()]
    assert steps == [(number, 6) for number in range(1, 7)]


def test_without_a_suspect_there_are_no_signatures() -> None:
    found: Judgeable[Candidate] = judgeable(
        [], lambda each: of_loudness(1.0), (W, PLACE.size), say=print
    )
    assert found.signatures.shape == (0, W, PLACE.size)
    assert found.suspects == ()


def test_a_candidate_can_be_asked_for_no_more_than_its_effect_allows() -> None:
    found = candidate_of(suspect())
    assert (found.name, found.units, found.sign) == ("haze", ("1",), (0,))
    assert found.limit == (2.0,)
    unbounded = EffectParameter("tilt", "deg", 0.0, 0.1, "negative")
    own = suspect().effect
    other = candidate_of(
        Candidate(Effect("tilt", "source", "", "", "", (unbounded,), "signal", own.change), "left")
    )
    assert other.name == "tilt[left]"
    assert (other.sign, other.limit) == ((-1,), (1.0,))
