"""Whole diagnoses: of the toy bench linearised (fast), and of the real fast engine."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from diagnosis import UNKNOWN, Candidate, Channel, Extra, Smoothness, diagnose, fit, next_captures
from diagnosis.attribution import PriorOdds, log_priors, scores_of
from diagnosis.calibration import detect
from diagnosis.evidence import hypotheses
from diagnosis.reduction import Reduction
from diagnosis.stepping import slopes
from diagnosis.unknown import Unknown


def generator(*key):
    return np.random.Generator(np.random.Philox(key=list(key)))


def alarms(linear_toy, modes, count, seed):
    """Share of data without an effect that raise an alarm at 5 %, assuming common modes."""
    assumed = replace(linear_toy.problem(0), common=modes)
    null = fit(assumed)
    scores, columns = scores_of(assumed, null)
    unknown = Unknown.of(assumed, null.reduction, null.predicted)
    allowed = list(range(len(assumed.candidates)))
    prior = log_priors(assumed, hypotheses(allowed, pairs=False), PriorOdds())
    drawn = generator(seed, 1)
    hits = 0
    for trial in range(count):
        residual = null.reduction(linear_toy.noise(drawn))
        own = replace(scores, inner=(columns.T @ residual)[None])
        found = detect(own, columns, residual, unknown, allowed, prior, np.log(0.05),
                       seed=trial, draws=400)  # fmt: skip
        hits += found.p <= 0.05
    return hits / count


def test_false_alarms_are_those_asked_for_with_drifting_lamps(linear_toy):
    rate = alarms(linear_toy, linear_toy.base.common, 150, 1)
    # binomial: five standard errors of 5 % in 150 trials are 9 %
    assert rate < 0.05 + 5 * np.sqrt(0.05 * 0.95 / 150)


def test_noise_taken_for_white_raises_false_alarms(linear_toy):
    """Negative control: the drift that neighbouring wavelengths share is left out."""
    assert alarms(linear_toy, linear_toy.base.common[:0], 40, 2) > 0.4


def test_singles_are_named_or_stated_as_a_group(linear_toy):
    right, sizes, covered = 0, [], 0
    names = [candidate.name for candidate in linear_toy.candidates][::2]
    for index, name in enumerate(names):
        values = {name: linear_toy.visible(name, 8.0)}
        found = diagnose(linear_toy.problem(100 + index, values), seed=index)
        right += found.leading == (name,)
        covered += name in found.credible_set or any(name in group for group in found.groups)
        sizes.append(len(found.credible_set))
    assert right >= len(names) - 2  # 85 % of nine, less one standard error
    assert covered >= len(names) - 1
    assert np.mean(sizes) <= 2.0


def test_pairs_are_found(linear_toy):
    pairs = [("thickness[s1]", "stray light"), ("dark offset", "black level"),
             ("gain step", "acceptance")]  # fmt: skip
    for seed, pair in enumerate(pairs):
        values = {name: linear_toy.visible(name, 12.0) for name in pair}
        found = diagnose(linear_toy.problem(200 + seed, values))
        assert set(pair) <= set(found.leading_set)
        assert found.verdict in ("pair", "group")


def test_amplitudes_are_inside_their_intervals(linear_toy):
    name, count, inside = "thickness[s1]", 120, 0
    truth = linear_toy.visible(name, 6.0)
    for seed in range(count):
        problem = linear_toy.problem(1000 + seed, {name: truth})
        found = fit(problem, (1,))
        sd = np.sqrt(found.covariance[0, 0])
        inside += abs(found.value[0] - truth[0]) < 1.645 * sd
    # binomial: four standard errors about 90 %
    assert abs(inside / count - 0.9) < 4 * np.sqrt(0.09 / count)


def without(problem, name):
    kept = [i for i, c in enumerate(problem.candidates) if c.name != name]
    columns = [column for i in kept for column in problem.columns[i]]
    return replace(problem, candidates=tuple(problem.candidates[i] for i in kept),
                   signatures=problem.signatures[columns])  # fmt: skip


def test_an_effect_outside_the_catalogue_is_none_of_these(linear_toy):
    problem = linear_toy.problem(300)
    tilt = linear_toy.toy.tilt[:, None]
    odd = np.array([c.capture == "white" and c.sample == "s1" for c in problem.channels])
    strange = linear_toy.level * odd * 0.03 * np.sin(7 * tilt)
    found = diagnose(replace(problem, value=problem.value + strange))
    assert found.verdict == "none_of_these"
    assert UNKNOWN in found.credible_set
    assert found.enters[0].heals
    assert (found.enters[0].captures, found.enters[0].samples) == (("white",), ("s1",))


def test_an_effect_taken_from_the_catalogue_is_missed(linear_toy):
    values = {"dark offset": linear_toy.visible("dark offset", 40.0)}
    whole = linear_toy.problem(301, values)
    assert diagnose(whole).verdict == "effect"
    assert diagnose(without(whole, "dark offset")).verdict == "none_of_these"


def test_no_gap_says_so(linear_toy):
    every = [diagnose(linear_toy.problem(20 + seed), seed=seed) for seed in range(5)]
    quiet = [found for found in every if found.verdict == "no_gap"]
    assert len(quiet) >= 4
    for found in quiet:
        assert found.p > 0.02
        assert found.closure is None


def test_where_a_single_repeat_went_wrong(linear_toy):
    problem = linear_toy.problem(302)
    odd = np.array([c.repeat == 1 and c.capture == "white" for c in problem.channels])
    found = diagnose(replace(problem, value=problem.value * (1 + 0.02 * odd)))
    assert found.verdict == "none_of_these"
    healing = [entry for entry in found.enters if entry.heals]
    assert any(entry.repeat == 1 for entry in healing)
    assert any(block.repeat == 1 and block.p < 0.05 for block in found.where)


def test_one_thickness_and_equal_thicknesses_cannot_tell(linear_toy):
    problem = linear_toy.problem(5)
    equal = replace(problem, thickness_mm=dict.fromkeys(problem.thickness_mm, 1.0))
    found = diagnose(equal)
    assert found.verdict == "cannot_tell"
    assert "equally thick" in found.reason
    one = [i for i, channel in enumerate(problem.channels) if channel.sample == "s0"]
    single = replace(
        problem, channels=tuple(problem.channels[i] for i in one), value=problem.value[:, one],
        valid=problem.valid[:, one], independent=problem.independent[:, one][:, :, one],
        common=problem.common[:, :, one], signatures=problem.signatures[:, :, one],
    )  # fmt: skip
    found = diagnose(single)
    assert found.verdict == "cannot_tell"
    assert "thickness" in found.reason
    assert len(found.not_identifiable) == len(problem.candidates)


def test_broken_and_invisible_candidates_are_listed(linear_toy):
    problem = linear_toy.problem(6, {"index": linear_toy.visible("index", 9.0)})
    signatures = problem.signatures.copy()
    signatures[0] = np.nan
    absorbed = np.einsum("wmp,p->wm", linear_toy.slope, [1.0, 0.5, 0.2])
    signatures = np.concatenate([signatures, absorbed[None]])
    more = (*problem.candidates, Candidate("a common scale"))
    found = diagnose(replace(problem, signatures=signatures, candidates=more))
    listed = {entry.name: entry.reason for entry in found.not_identifiable}
    assert "no numbers" in listed["thickness[s0]"]
    assert "standard deviations" in listed["a common scale"]
    assert found.leading == ("index",)


def test_an_effect_that_refuses_its_values_is_named_and_left_out(linear_toy):
    problem = linear_toy.problem(13, {"index": linear_toy.visible("index", 9.0)})

    def forward(material, effects):
        if "index" in effects:
            raise ValueError("no such index")
        return linear_toy.forward(material, effects)

    found = diagnose(replace(problem, forward=forward))
    listed = {entry.name: entry.reason for entry in found.not_identifiable}
    assert "no such index" in listed["index"]
    assert "index" not in found.leading


def walled(linear_toy, name, lower, upper):
    """The linear bench with a twin that has no answer beyond values of one effect."""

    def forward(material, effects):
        data = linear_toy.forward(material, effects)
        value = float(effects[name][0]) if name in effects else 0.0
        bent = data * (1.0 + 0.3 * value**2)  # derivatives must be renewed
        return bent if lower <= value <= upper else np.full_like(data, np.nan)

    return forward


def test_a_fit_stays_where_the_twin_has_an_answer(linear_toy):
    value = linear_toy.visible("index", 12.0)
    clean = linear_toy.problem(13, {"index": value})
    size = float(value[0])
    forward = walled(linear_toy, "index", -1.0, size * 1.01)
    free = fit(replace(clean, forward=walled(linear_toy, "index", -9.0, 9.0)), (3,), fit(clean))
    found = fit(replace(clean, forward=forward), (3,), fit(clean))
    assert np.isfinite(found.columns).all()
    assert found.value[0] <= size * 1.01
    assert found.value[0] == pytest.approx(free.value[0], abs=3 * np.sqrt(free.covariance[0, 0]))
    slope = slopes(replace(clean, forward=forward), [clean.candidates[3]], clean.material,
                   np.array([size]), forward(clean.material, {"index": value}))  # fmt: skip
    # the first step of 5 % would lead beyond the wall: the slope is taken backwards
    back = {"index": np.array([0.95 * size])}
    expected = forward(clean.material, {"index": value}) - forward(clean.material, back)
    step = max(0.05 * size, 0.1 * clean.candidates[3].prior_scale[0])
    assert slope[0] == pytest.approx(expected / (0.05 * size), rel=0.2 * step / size + 0.05)


def test_an_effect_without_finite_slopes_is_listed_with_the_reason(linear_toy):
    value = linear_toy.visible("index", 12.0)
    problem = linear_toy.problem(13, {"index": value})
    point = float(fit(problem, (3,), fit(problem)).value[0])

    def forward(material, effects):
        """Finite at no effect and at the first step of the fit alone."""
        data = linear_toy.forward(material, effects)
        if "index" not in effects or abs(effects["index"][0] - point) < 1e-9 * point:
            return data * (1.0 + ("index" in effects) * 1e-2)
        return np.full_like(data, np.nan)

    found = diagnose(replace(problem, forward=forward))
    listed = {entry.name: entry.reason for entry in found.not_identifiable}
    assert "no finite answer beside n of index" in listed["index"]
    assert "index" not in found.leading
    assert all(np.isfinite(entry.probability) for entry in found.effects)


def test_masked_data_are_not_looked_at(linear_toy):
    problem = linear_toy.problem(7, {"index": linear_toy.visible("index", 9.0)})
    valid, value = problem.valid.copy(), problem.value.copy()
    valid[3:6, 4], value[3:6, 4] = False, np.nan
    found = diagnose(replace(problem, valid=valid, value=value))
    assert found.leading == ("index",)
    assert found.null is not None
    assert found.null.reduction.freedom == valid.sum() - 3 * len(problem.wavelength_nm)


def test_the_next_capture_is_the_one_that_splits_the_group(linear_toy):
    problem = linear_toy.problem(8, {"acceptance": linear_toy.visible("acceptance", 4.5)})
    names = [candidate.name for candidate in problem.candidates]
    twin = problem.signatures[problem.columns[names.index("acceptance")][0]]
    signatures = np.concatenate([problem.signatures, 1.1 * twin[None]])
    double = replace(problem.candidates[names.index("acceptance")], effect="its double")

    def forward(material, effects):
        known = {name: value for name, value in effects.items() if name != "its double"}
        data = linear_toy.forward(material, known)
        return data + 1.1 * twin * np.sum(effects.get("its double", 0.0))

    problem = replace(problem, candidates=(*problem.candidates, double), signatures=signatures,
                      forward=forward)  # fmt: skip
    width = len(problem.wavelength_nm)
    telling = np.zeros((len(signatures), width, 1))
    telling[-1] = 0.2
    common = {
        "channels": (Channel("empty", ""),),
        "independent": np.full((width, 1, 1), 1e-6),
        "common": np.zeros((len(problem.common), width, 1)),
        "jacobian": np.zeros((width, 1, 3)),
    }
    dull = Extra(name="dull", cost=1.0, signatures=0.0 * telling, **common)
    good = Extra(name="good", cost=5.0, signatures=telling, **common)
    found = diagnose(problem, extras=(dull, good))
    assert found.verdict == "group"
    assert {"acceptance", "its double"} <= set(found.groups[0])
    assert {n.name for n in found.next_measurement} == {"good", "dull"}
    index = names.index("acceptance")
    amplitude = {index: np.array([0.05]), len(names): np.array([0.05])}
    assert found.null is not None
    good_one, dull_one = next_captures(problem, found.null, (dull, good), amplitude, amplitude)
    assert (good_one.name, good_one.enough) == ("good", True)
    assert dull_one.separation == pytest.approx(dull_one.now, abs=1e-6)


def test_the_same_seed_gives_the_same_bytes_and_the_keys_are_those_agreed(linear_toy):
    problem = linear_toy.problem(9, {"index": linear_toy.visible("index", 9.0)})
    first, second = (json.dumps(diagnose(problem, seed=3).as_json()) for _ in range(2))
    assert first == second
    keys = {"verdict", "effects", "groups", "where", "closure", "parameter_shift",
            "next_measurement", "not_identifiable"}  # fmt: skip
    found = json.loads(first)
    assert keys <= set(found)
    assert {"name", "probability", "parameters"} <= set(found["effects"][0])
    assert {"value", "interval", "before", "after", "noise_floor"} <= set(found["closure"])


def test_a_smoothness_prior_is_compared(linear_toy):
    values = {"thickness[s1]": linear_toy.visible("thickness[s1]", 12.0)}
    problem = linear_toy.problem(10, values)
    prior = Smoothness(60.0, (0.5, 0.3, 0.3), (0.02, 0.02, 0.02))
    found = diagnose(replace(problem, material_prior=prior))
    assert found.leading == ("thickness[s1]",)
    assert found.prior_dependent == ""


def test_the_real_engine_with_a_strong_nonlinear_effect(toy):
    problem = toy.problem(11, {"thickness[s1]": [0.1]})
    found = diagnose(problem)
    assert found.verdict == "effect"
    assert found.leading == ("thickness[s1]",)
    value = found.effects[0].parameters[0]
    assert found.effects[0].refitted
    assert abs(value.value - 0.1) < 4 * value.sd
    assert found.effects[0].strength > 30
    assert found.parameter_shift is not None
    assert max(found.parameter_shift.rms_sd) > 1
    assert found.closure is not None
    assert found.closure.value > 0.9
    assert found.adequacy is not None
    assert found.adequacy.enough


def test_the_reduction_of_a_fit_is_about_the_fit(toy):
    problem = toy.problem(12)
    null = fit(problem)
    again = Reduction.of(problem, problem.jacobian(null.material, {}))
    assert null.converged
    # chi-square of the no-effect model, five standard errors
    freedom = null.reduction.freedom
    assert abs(null.chi_square - freedom) < 5 * np.sqrt(2 * freedom)
    assert again.freedom == freedom
