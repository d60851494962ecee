"""What is left after an explanation: patterns that no smooth look sees, and controls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis import fit
from diagnosis.adequacy import adequacy

LOOK = "alike in all repeats"


def rest_with(toy, seed, size, by_repeat):
    """Adequacy of no effect where captures have fringes of a size [standard deviations]."""
    problem = toy.problem(seed)
    null = fit(problem)
    random = np.random.Generator(np.random.Philox(key=[seed, 9]))
    shape = np.sign(np.sin(1.9 * np.arange(len(problem.wavelength_nm))))[:, None]
    signs = random.choice([-1.0, 1.0], size=9)
    weight = np.array([by_repeat[each.repeat] for each in problem.channels])
    pattern = shape * null.predicted * np.tile(signs, len(by_repeat)) * weight
    flat = null.reduction(pattern)
    flat = flat * size / np.linalg.norm(flat)
    found = adequacy(problem, replace(null, residual=null.residual + flat))
    return {name: p for name, _, _, p in found.tests}, found


@pytest.mark.parametrize("seed", [1, 2])
def test_fringes_that_all_repeats_share_are_seen(linear_toy, seed):
    looks, found = rest_with(linear_toy, seed, 14.0, (1.0, 1.0, 1.0))
    assert looks[LOOK] < 1e-4
    assert found.p < 0.01
    assert not found.enough
    # the same energy hides from all that do not look for what is shared
    assert looks[LOOK] < 0.1 * min(p for name, p in looks.items() if "alike" not in name)


def test_what_repeats_do_not_share_is_no_such_pattern(linear_toy):
    looks, _ = rest_with(linear_toy, 3, 14.0, (1.0, -0.5, -0.5))
    assert looks[LOOK] > 0.01


def test_noise_alone_is_enough(linear_toy):
    count = sum(not rest_with(linear_toy, 40 + seed, 0.0, (1.0, 1.0, 1.0))[1].enough
                for seed in range(12))  # fmt: skip
    # 1 % each: three of twelve are three in ten thousand
    assert count <= 2


@pytest.mark.parametrize("seed", [1, 2])
def test_what_all_captures_share_is_seen_best_together(linear_toy, seed):
    problem = linear_toy.problem(seed)
    null = fit(problem)
    shape = np.sign(np.sin(1.9 * np.arange(len(problem.wavelength_nm))))[:, None]
    flat = null.reduction(shape * null.predicted)
    flat = flat * 9.0 / np.linalg.norm(flat)
    found = adequacy(problem, replace(null, residual=null.residual + flat))
    looks = {name: p for name, _, _, p in found.tests}
    assert looks["alike in all captures"] < 1e-4
    assert looks["alike in all captures"] < 0.1 * looks[LOOK]
    assert found.p < 1e-3
    assert not found.enough


def test_probabilities_go_on_beyond_the_simulation(linear_toy):
    faint, loud = (rest_with(linear_toy, 5, size, (1.0, 1.0, 1.0))[1] for size in (15.0, 25.0))
    assert loud.p < 1e-6 * faint.p
    assert loud.p >= min(p for _, _, _, p in loud.tests)
