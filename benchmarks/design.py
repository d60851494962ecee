"""Design studies: speed, predicted against simulated uncertainty, what is cheaper than the seed.

Keys:

- `designs_1000_s`: 1000 candidates drawn from the goal "resin" by Fisher information, programs
  compiled; `designs_1000_kept_s`: the same again, its tables kept; `designs_1000_cpu_s`: processor
  time of the first; `targets`: figures of each.
- `ratio_within`: share of simulated candidates whose actual error over the predicted one lies
  between 0.85 and 1.15, of albedo, sigma_t and g apart; `ratio_all`: of all three together;
  `ratios`, `width_ratios`: of each; `width_within`: the same of the uncertainty that the estimate
  states. `failed`: candidates whose simulation failed, with the reason.
- `cheaper_found`: whether a candidate cheaper than the seed's bench with its spectrometer is
  predicted to be as accurate in every figure; `cost_ratio`: its price over the seed's;
  `cheaper_score`: its largest figure over the seed's, predicted, and `cheaper_score_simulated`:
  the same of actual errors less the Monte Carlo's own, where both were simulated, with its
  standard error.
- `ratio_errors`: standard errors of `ratios`, over visits and wavelengths.
- These are of two goals: a material that is the same at all wavelengths, and a white resin whose
  extinction falls fourfold from blue to red (the library's of the goal "resin"), where chips see
  averages. Of the second the first six candidates with a chip and the first four without are taken
  from one sequence of random ones. `chips`: which rows they are; `ratio_within_chip`: of chips
  alone; `ratio_within_steep`: of the second goal; `ratios_without_bands`: of
  chips, had the prediction left the bands out: a control.
- `table1`, and with the ending `_fluorescent` `ratio_within`, `ratios`, `ratio_errors`,
  `cheaper_found`, `cost_ratio`, `cheaper`, `rank_correlation`, `designs_1000_s`: of
  `benchmarks.design_fluorescent`.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.console import Console
from scenarios.design import (
    Candidate,
    Goal,
    Parts,
    Space,
    TranslucentPredictor,
    load_goal,
    load_parts,
    verify,
)
from scenarios.design.study import compared_candidate
from scenarios.design.verified import Verified
from twin.cache import cache_folder

WITHIN = (0.85, 1.15)
CANDIDATES, QUICK_CANDIDATES = 10, 3
GOAL = {
    "title": "benchmark",
    "materials": [{"name": "resin", "albedo": 0.95, "sigma_t_per_mm": 3.0, "g": 0.7, "n": 1.4}],
    "targets": {"albedo": 0.01, "sigma_t_relative": 0.03, "g": 0.03},
    "protocol": {"thickness_mm": [0.3, 0.9], "samples": [2], "averages": [10]},
    "wavelength": {"start_nm": 440.0, "stop_nm": 680.0, "step_nm": 20.0},
    "verification": {"seeds": 96, "paths": 1 << 18, "map_paths": 4096},
}
CHIP = "as7341"
STEEP_COUNT, QUICK_STEEP_COUNT = (6, 4), (2, 0)
"""Candidates of the steep goal with a chip and without."""
STEEP = {
    "title": "benchmark, steep",
    "materials": [{"name": "polyjet_white", "n": 1.5}],
    "targets": {"albedo": 0.002, "sigma_t_relative": 0.03, "g": 0.03},
    "protocol": {"thickness_mm": [0.3, 0.6], "samples": [2], "averages": [10]},
    "wavelength": {"start_nm": 420.0, "stop_nm": 680.0, "step_nm": 20.0},
    "verification": {"seeds": 48, "paths": 1 << 16, "map_paths": 4096},
}


def speed() -> dict[str, Any]:
    """1000 candidates."""
    goal, parts = load_goal("resin")
    space, predictor = Space.of(goal, parts), TranslucentPredictor(goal, parts)
    predictor.predict([space.at([0] * len(space.shape))])
    rng = np.random.Generator(np.random.Philox(key=3))
    chosen = [space.at([int(rng.integers(n)) for n in space.shape]) for _ in range(1000)]
    wall, busy = time.perf_counter(), time.process_time()
    predictor.predict(chosen)
    first, used = time.perf_counter() - wall, time.process_time() - busy
    wall = time.perf_counter()
    predictor.predict(chosen)
    return {
        "designs_1000_s": first,
        "designs_1000_cpu_s": used,
        "designs_1000_kept_s": time.perf_counter() - wall,
        "targets": len(goal.targets.names),
    }


def cheaper(goal: Goal, parts: Parts) -> tuple[dict[str, Any], Candidate, Candidate]:
    """The cheapest candidate that is predicted to be as accurate as the seed's bench."""
    predictor = TranslucentPredictor(goal, parts)
    seed = compared_candidate("seed-translucent", goal, parts)
    least = predictor.predict([seed])[0]
    every = sorted(Space.of(goal, parts), key=lambda each: each.price(parts))
    score = (predictor.predict(every) / least).max(axis=1)
    number = int(np.argmax(score <= 1.0))
    found = every[number] if score[number] <= 1.0 else seed
    ratio = found.price(parts) / seed.price(parts)
    facts = {
        "cheaper_found": bool(ratio < 1.0), "cost_ratio": ratio,
        "cheaper_score": float((predictor.predict([found])[0] / least).max()),
        "cheaper": found.text, "candidates": len(every),
    }  # fmt: skip
    return facts, seed, found


def steep(quick: bool, parts: Parts) -> list[Verified]:
    """Candidates with chips and without, of a material whose spectrum is steep, simulated."""
    goal = Goal.model_validate(STEEP)
    space = Space.of(goal, parts)
    rng = np.random.Generator(np.random.Philox(key=13))
    left = list(QUICK_STEEP_COUNT if quick else STEEP_COUNT)
    chosen: list[Candidate] = []
    while any(left):
        own = space.at([int(rng.integers(n)) for n in space.shape])
        kind = int(CHIP not in own.parts)
        if left[kind] and own not in chosen:
            chosen.append(own)
            left[kind] -= 1
    return simulated(goal, TranslucentPredictor(goal, parts), chosen)


def simulated(
    goal: Goal, predictor: TranslucentPredictor, chosen: list[Candidate]
) -> list[Verified]:
    """Candidates in full; what is in the cache is not done again."""
    print(f"simulating {len(chosen)} candidates", file=sys.stderr)
    folder = Path(cache_folder("design")) / "benchmark"
    return verify(goal, predictor, chosen, folder, console=Console())


def inside(values: np.ndarray) -> np.ndarray:
    """Which ratios agree."""
    return np.asarray((values >= WITHIN[0]) & (values <= WITHIN[1]))


def share(values: np.ndarray) -> float | None:
    """Of ratios that agree; None: there are none."""
    return float(inside(values).mean()) if values.size else None


def run(quick: bool) -> dict[str, Any]:
    """All figures."""
    facts = speed()
    parts, goal = load_parts(), Goal.model_validate(GOAL)
    count = QUICK_CANDIDATES if quick else CANDIDATES
    found, seed, other = cheaper(goal, parts)
    facts |= found
    space = Space.of(goal, parts)
    rng = np.random.Generator(np.random.Philox(key=7))
    drawn = [space.at([int(rng.integers(n)) for n in space.shape]) for _ in range(count)]
    chosen = list(dict.fromkeys([seed, other, *drawn]))[:count]
    flat = simulated(goal, TranslucentPredictor(goal, parts), chosen)
    facts |= ratios([*flat, *steep(quick, parts)], len(flat))
    by_candidate = {each.candidate: each for each in flat if not each.failure}
    if seed in by_candidate and other in by_candidate:
        one, two = by_candidate[seed], by_candidate[other]
        score = two.actual / one.actual
        worst = int(np.argmax(score))
        # the visits of both have the same random numbers: their ratio is surer than this
        apart = [each.ratio_error[worst] / each.ratio[worst] for each in (one, two)]
        facts["cheaper_score_simulated"] = float(score[worst])
        facts["cheaper_score_simulated_error"] = float(score[worst] * np.hypot(*apart))
    return facts | fluorescent(quick)


def ratios(done: list[Verified], flat: int) -> dict[str, Any]:
    """Actual over predicted errors of candidates, the first `flat` of them of the flat goal."""
    good = [each for each in done if not each.failure]
    found = np.array([each.ratio for each in good]).reshape(-1, 3)
    widths = np.array([each.width_ratio for each in good]).reshape(-1, 3)
    chip = np.array([CHIP in each.candidate.parts for each in good], dtype=bool)
    first_steep = sum(not each.failure for each in done[:flat])
    without = np.array([replace(each, bands=None).ratio for each in good]).reshape(-1, 3)
    return {
        "ratio_within": share(found),
        "ratio_within_chip": share(found[chip]),
        "ratio_within_steep": share(found[first_steep:]),
        "ratio_all": float(inside(found).all(axis=1).mean()) if good else None,
        "ratios": found.round(3).tolist(),
        "ratio_errors": [each.ratio_error.round(3).tolist() for each in good],
        "chips": np.flatnonzero(chip).tolist(),
        "ratios_without_bands": without[chip].round(3).tolist(),
        "width_within": share(widths),
        "width_ratios": widths.round(3).tolist(),
        "bias": [each.bias.round(3).tolist() for each in good],
        "simulated": len(good),
        "failed": [each.failure for each in done if each.failure],
    }


def fluorescent(quick: bool) -> dict[str, Any]:
    """The keys of `benchmarks.design_fluorescent` that belong to the same questions."""
    from benchmarks import design_fluorescent

    found = design_fluorescent.run(quick)
    names = {
        "table1": "table1", "prices_exact": "prices_exact", "ranks_agree": "ranks_agree",
        "ratio_within": "ratio_within_fluorescent", "ratios": "ratios_fluorescent",
        "ratio_errors": "ratio_errors_fluorescent", "candidates": "candidates_fluorescent",
        "materials": "materials_fluorescent", "cheaper_found": "cheaper_found_fluorescent",
        "cost_ratio": "cost_ratio_fluorescent", "cheaper": "cheaper_fluorescent",
        "cheaper_within_error": "cheaper_within_error_fluorescent",
        "rank_correlation": "rank_correlation_fluorescent",
        "designs_1000_s": "designs_1000_s_fluorescent",
    }  # fmt: skip
    return {new: found[old] for old, new in names.items()}
