"""What to measure next, and what becomes of entries of the catalogue that misbehave."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.extras import extras_of, minutes_of_a_sample
from diagnosis.proposals import with_proposals
from diagnosis.rounds import Rounds, diagnose_rounds
from tests.diagnosis.visits import small_catalogue, visit
from twin.effects import Effect, EffectParameter
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
