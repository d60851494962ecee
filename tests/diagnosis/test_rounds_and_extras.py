"""What to measure next, and what becomes of entries of the catalogue that misbehave."""

from __future__ import annotations

from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.extras import extras_of, minutes_of_a_sample
from diagnosis.proposals import with_proposals
from diagnosis.response_noise import Loudness
from diagnosis.rounds import Accepted, Rounds, diagnose_rounds
from diagnosis.translucent import translucent_case
from scenarios.report_diagnosis import Named, as_json, diagnosis_page, terminal
from tests.diagnosis.visits import small_catalogue, visit
from twin.effects import Effect, EffectEngine, EffectParameter, LeftOut
from twin.errors import InputError
from twin.measurement import Measurement


def _raises(world: object, values: object, instance: str) -> object:
    raise ZeroDivisionError("tarnish divides by nothing")


def _no_number(world, values, instance):  # type: ignore[no-untyped-def]
    return world.with_step(lambda rates: rates.scaled((3,), np.nan))


def _broken(name: str, change) -> Effect:  # type: ignore[no-untyped-def]
    return Effect(
        name=name, place="detector", title=name, physics="none", source="this test",
        parameters=(EffectParameter("amount", "1", 0.0, 0.1),), engine="signal", change=change,
    )  # fmt: skip


@pytest.fixture(scope="module")
def measured() -> Measurement:
    return visit("black_level", 0.05, protocol={"repeats": 1, "reference_repeats": 1})


@pytest.fixture(scope="module")
def found(measured: Measurement, tmp_path_factory: pytest.TempPathFactory) -> Rounds:
    effects = small_catalogue().with_effects(
        [_broken("tarnish", _raises), _broken("gremlins", _no_number)]
    )
    said: list[str] = []
    folder = tmp_path_factory.mktemp("responses")
    rounds = diagnose_rounds(
        measured, effects=effects, folder=folder, proposals=False, say=said.append
    )
    assert any("tarnish" in line for line in said)
    return rounds


def test_broken_entries_are_named_and_the_rest_goes_on(found: Rounds) -> None:
    left = {each.name: each.reason for each in found.first.case.left_out}
    assert "ZeroDivisionError" in left["tarnish"]
    assert "gremlins" in left
    assert "black_level" in [effect.name for effect in found.first.diagnosis.effects]


def test_what_was_left_out_is_told_with_its_reason(found: Rounds, measured: Measurement) -> None:
    named = Named.of(found.first.case.suspects)
    facts = as_json(found, named, None)
    reasons = {each["name"]: each["reason"] for each in facts["not_identifiable"]}
    assert reasons["tarnish"] == "ZeroDivisionError: tarnish divides by nothing"
    assert reasons["gremlins"].startswith("InputError: found counts that no charge gives")
    assert f"tarnish: {reasons['tarnish']}" in terminal(found, named, None)["left_out"]
    page = unescape(diagnosis_page(measured, found, None, bench_file="bench.toml"))
    for name in ("tarnish", "gremlins"):
        assert reasons[name] in page.split("<h3>Left out</h3>", 1)[1].split("</table>", 1)[0], name


def test_a_response_that_is_not_known_well_enough_is_left_out(
    measured: Measurement, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def heard(engine, suspect, material, signature, place, reduction):  # type: ignore[no-untyped-def]
        assert signature.shape == (1, len(material), len(place))
        assert np.any(reduction(np.moveaxis(signature, 0, -1)))
        return Loudness(1.0, 9.0) if suspect.name == "black_level" else Loudness(9.0, 0.0)

    monkeypatch.setattr("diagnosis.translucent.loudness", heard)
    said: list[str] = []
    effects = small_catalogue().without(["drift", "thickness", "stray_light"])
    case = translucent_case(measured, effects=effects, folder=tmp_path, say=said.append)
    assert [each.name for each in case.left_out] == ["black_level"]
    reason = case.left_out[0].reason
    assert reason.startswith("its response is not known well enough: 1.0 sigma for one prior scale")
    assert reason.endswith("9.0 may be noise of the 65536 light paths"), (
        "8 times as many were tried"
    )
    assert f"left out: black_level: {reason}" in said
    assert [each.name for each in case.suspects] == [c.name for c in case.problem.candidates]
    assert "refractive_index" in [each.name for each in case.suspects]


def test_a_later_round_says_what_it_alone_leaves_out(
    measured: Measurement, monkeypatch: pytest.MonkeyPatch
) -> None:
    left_out = iter([(LeftOut("a", "1 sigma"),), (LeftOut("a", "2 sigma"), LeftOut("b", "noise"))])
    diagnosis = SimpleNamespace(verdict="effect", best=SimpleNamespace(hypothesis=(0,)))
    for name, answer in (
        ("translucent_case", lambda *_, **__: SimpleNamespace(left_out=next(left_out), problem=0)),
        ("diagnose", lambda *_, **__: diagnosis),
        ("_accept", lambda visit, *_: (visit.bench, (Accepted("c", "c", (1.0,), (0.1,)),))),
    ):
        monkeypatch.setattr(f"diagnosis.rounds.{name}", answer)
    said: list[str] = []
    rounds = diagnose_rounds(measured, most=2, proposals=False, say=said.append)
    assert said == ["left out in round 2: b: noise"]
    assert rounds.left_out == (LeftOut("a", "1 sigma"), LeftOut("b", "in round 2: noise"))


def test_a_description_that_cannot_be_is_one_message(
    found: Rounds, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An effect may lead where nothing can be predicted, and gives no number; not so the bench."""

    def refuses(*_: object) -> None:
        raise InputError("a bench of glass", "one that can be")

    problem = found.first.case.problem
    monkeypatch.setattr(EffectEngine, "intensities", refuses)
    assert np.isnan(problem.forward(problem.material, {"black_level": np.array([0.01])})).all()
    with pytest.raises(InputError, match="a bench of glass"):
        problem.forward(problem.material, {})


def test_captures_of_fewer_repeats_than_others_get_proposals_too(
    found: Rounds, measured: Measurement
) -> None:
    """A sample whose first black was thrown away: its noise is that of the next repeat."""
    case, null = found.first.case, found.first.diagnosis.null
    assert null is not None
    channels = list(case.problem.channels)
    channels[0] = replace(channels[0], repeat=1)
    problem = replace(case.problem, channels=tuple(channels))
    plain = {each.name: each for each in extras_of(case, measured, null, ())}
    extras = extras_of(replace(case, problem=problem), measured, null, ())
    assert [each.name for each in extras] == list(plain)
    for each in extras:
        own = plain[each.name].independent.shape[1]
        assert each.independent.shape[1] == 2 * own
        assert np.all(np.linalg.eigvalsh(each.independent) > 0)


def test_a_single_repeat_is_judged_with_the_instruments_noise(found: Rounds) -> None:
    assert {channel.repeat for channel in found.first.case.problem.channels} == {0}
    assert any("noise of counts from the description" in r for r in found.first.case.reasons)


def test_extras_continue_the_problem(found: Rounds, measured: Measurement) -> None:
    case, null = found.first.case, found.first.diagnosis.null
    assert null is not None
    extras = extras_of(case, measured, null, ("black_level", "refractive_index"))
    names = [extra.name for extra in extras]
    assert any("3.2 mm" in name for name in names)
    assert any("empty bench" in name for name in names)
    wavelengths = len(case.problem.wavelength_nm)
    for extra in extras:
        count = len(extra.channels)
        assert extra.cost > 0
        assert extra.independent.shape == (wavelengths, count, count)
        assert np.all(np.linalg.eigvalsh(extra.independent) > 0)
        assert extra.common.shape[1:] == (wavelengths, count)
        assert len(extra.common) >= len(case.problem.common)
        assert np.isfinite(extra.signatures).all()
        assert np.isfinite(extra.jacobian).all()


def test_the_empty_bench_sees_the_black_and_nothing_of_the_material(
    found: Rounds, measured: Measurement
) -> None:
    case, null = found.first.case, found.first.diagnosis.null
    assert null is not None
    extra = extras_of(case, measured, null, ("black_level", "refractive_index"))[-1]
    columns = dict(
        zip((c.name for c in case.problem.candidates), case.problem.columns, strict=True)
    )
    black = extra.signatures[columns["black_level"][0]]
    np.testing.assert_allclose(black, 1.0, atol=0.02)  # a reflectance is read as it is
    assert np.all(extra.signatures[columns["refractive_index"][0]] == 0.0)
    assert np.all(extra.jacobian == 0.0)


def test_proposals_are_made_for_look_alikes_alone(found: Rounds, measured: Measurement) -> None:
    diagnosis = found.first.diagnosis
    proposed = with_proposals(found.first.case, measured, diagnosis)
    alike = len([n for n in diagnosis.credible_set if n != "none of these"]) > 1
    assert bool(proposed.next_measurement) == (alike or bool(diagnosis.groups))
    for each in proposed.next_measurement:
        assert each.separation >= each.now - 1e-6, "more data cannot tell less"


def test_minutes_come_from_the_visit(measured: Measurement) -> None:
    assert 0.1 < minutes_of_a_sample(measured) < 60.0


def test_no_round_at_all_is_refused(measured: Measurement) -> None:
    with pytest.raises(InputError, match="0 rounds"):
        diagnose_rounds(measured, most=0)
