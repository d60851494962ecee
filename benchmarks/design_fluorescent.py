"""Fluorescence set-ups before they are bought: predicted against simulated accuracy, and prices.

Materials are generated (dyes of the library, varied; `scenarios.design.fluorescent_population`):
those of population 1 are for choosing, the 24 of population 2 for judging. Figures of a set-up are
geometric means over the materials. Simulated: visits through the instruments, corrections, the
estimator `donaldson`.

Keys:

- `table1`: the seed's four set-ups, price [USD], predicted and simulated RMSE of the 465 cells and
  of the diagonal, CIEDE2000, ranks; `prices_exact`, `ranks_agree`.
- `ratio_within`: share of candidates whose predicted over simulated RMSE of the 465 cells is 0.85
  to 1.15; `ratio_within_diagonal`, `ratio_within_de2000`; `ratios` each with `ratio_errors` (over
  the materials); `outside_by_more_than_two_errors`: candidates whose ratio lies further outside
  0.85 to 1.15 than twice its standard error; `ratio_median`, `rank_correlation`, `candidates`,
  `materials`.
- `cheaper_found`, `cost_ratio`: designs chosen on population 1 that cost less than a set-up of the
  seed and whose RMSE of cells and of the diagonal is no larger, predicted and simulated
  (`cheaper`: each with price, and error over that of the seed's set-up, predicted and simulated
  with its standard error).
  `cost_ratio` is the least price over that of the set-up of the seed that was beaten.
  `cheaper_within_error`: price ratios of those with no such figure larger by more than its standard
  error. `cheaper_among_l1`: how many choices of the eight LEDs of L1 alone are as good in
  prediction.
- `each_light_buys`: by detector, the best choice of 1, 2 ... 8 LEDs of L1 and its predicted RMSE;
  `without_each`: how many times larger the RMSE is without one LED.
- `fitted_s`: processor time [s] of one prediction with fitted products, those that are compared.
- `designs_1000_s`: time [s] of 1000 linear predictions on all cores (half with each detector,
  choices of the LEDs of L1 with 3 and 10 shots), warm; `designs_1000_cpu_s`: processor time.
"""

from __future__ import annotations

import sys
import time
from itertools import combinations
from typing import Any

import numpy as np

CHOOSING, JUDGING = 1, 2
VARIED, MATERIALS = 16, 24
PRICES = [2004.0, 29.0, 2165.0, 190.0]
"""Of the seed's L1-S1, L1-S2, L2-S1 and L2-S2 [USD]."""
_TWELVE = (
    "violet", "blue", "cyan", "green", "amber", "red", "warm_white", "cool_white",
    "royal_blue", "yellow_green", "orange", "deep_red",
)  # fmt: skip
CHALLENGERS = {
    "L1-S2": (
        ("violet", "blue", "cyan", "green", "amber", "cool_white", "yellow_green"), "S2", 3,
    ),
    "L1-S1": (
        ("violet", "blue", "cyan", "green", "warm_white", "yellow_green", "orange"), "S1", 3,
    ),
    "L2-S2": (_TWELVE, "S2", 3),
    "L2-S1": (_TWELVE, "S1", 3),
}  # fmt: skip
"""Seven LEDs for eight: with S2 the best of all choices of up to eight of thirteen LEDs that cost
less than L1's and are as good in all three figures; with S1 among its best forty. For filters on a
panel: the LEDs of L1 and four more. All chosen by prediction on population 1."""


def run(quick: bool) -> dict[str, Any]:
    """The keys above."""
    from scenarios.design.fluorescent_compare import compared, table1
    from scenarios.design.fluorescent_search import (
        SEED_DESIGNS,
        FluorescentDesign,
        varied_designs,
    )

    found: dict[str, Any] = _choices(quick)
    seeds = list(SEED_DESIGNS.values())
    varied = list(varied_designs(2 if quick else VARIED, seed=JUDGING))
    chosen = [FluorescentDesign(*each) for each in CHALLENGERS.values()]
    designs = [*seeds, *varied, *chosen]
    comparison = compared(
        designs, materials=4 if quick else MATERIALS, population_seed=JUDGING,
        progress=lambda done, of: print(f"simulated {done} of {of}", file=sys.stderr, flush=True),
    )  # fmt: skip
    rows = table1(comparison)
    judged = slice(0, len(seeds) + len(varied))
    for figure, ending in (("lower", ""), ("diagonal", "_diagonal"), ("colour", "_de2000")):
        ratio = comparison.ratio(figure)[judged]
        found[f"ratio_within{ending}"] = float(np.mean((ratio >= 0.85) & (ratio <= 1.15)))
        found[f"ratio_median{ending}"] = float(np.median(ratio))
    scatter = comparison.ratio_error() / comparison.ratio()
    far = np.abs(np.log(comparison.ratio())) > np.log(1.15) + 2.0 * scatter
    found |= {
        "table1": rows,
        "prices_exact": [row["price_usd"] for row in rows.values()] == PRICES,
        "ranks_agree": all(r["predicted_rank"] == r["simulated_rank"] for r in rows.values()),
        "ratios": {
            design.text: float(value)
            for design, value in zip(designs, comparison.ratio(), strict=True)
        },
        "ratio_errors": [float(each) for each in comparison.ratio_error()],
        "outside_by_more_than_two_errors": int(far[judged].sum()),
        "rank_correlation": comparison.rank_correlation(),
        "candidates": len(seeds) + len(varied), "materials": 4 if quick else MATERIALS,
    }  # fmt: skip
    population = found.pop("population")
    found["designs_1000_s"], found["designs_1000_cpu_s"] = _thousand(population)
    found["fitted_s"] = _fitted(population)
    return found | _cheaper(comparison)


def _choices(quick: bool) -> dict[str, Any]:
    """All choices of L1's LEDs, for population 1."""
    from scenarios.design.fluorescent_parts import SEED_LIGHTS
    from scenarios.design.fluorescent_population import fluorescent_population
    from scenarios.design.fluorescent_prior import linearised_population
    from scenarios.design.fluorescent_search import (
        SEED_DESIGNS,
        best_of_size,
        exhaustive,
        without_each,
    )

    population = linearised_population(fluorescent_population(4 if quick else 12, seed=CHOOSING))
    every = exhaustive(SEED_LIGHTS["L1"], population)
    buys, without, cheaper = {}, {}, {}
    for detector in ("S1", "S2"):
        whole = SEED_DESIGNS[f"L1-{detector}"]
        buys[detector] = {
            str(size): {
                "lights": " ".join(every.designs[n].lights), "price_usd": float(every.price_usd[n]),
                "predicted_rmse": float(every.rmse_lower[n]),
            }
            for size, n in best_of_size(every, detector).items()
        }  # fmt: skip
        without[detector] = without_each(every, whole)
        cheaper[detector] = len(every.as_good_as(every.number_of(whole)))
    print(f"predicted {len(every.designs)} choices", file=sys.stderr, flush=True)
    return {
        "each_light_buys": buys, "without_each": without, "cheaper_among_l1": cheaper,
        "population": population,
    }  # fmt: skip


def _fitted(population: Any) -> float:
    """Processor time [s] of one fitted prediction, of the seed's set-ups."""
    from scenarios.design.fluorescent_fitted import STEPS
    from scenarios.design.fluorescent_search import SEED_DESIGNS, predict_designs

    begin = time.process_time()
    predict_designs(list(SEED_DESIGNS.values()), population, steps=STEPS)
    return (time.process_time() - begin) / len(SEED_DESIGNS)


def _cheaper(comparison: Any) -> dict[str, Any]:
    """Challengers against the set-up of the seed that they are to replace, on population 2."""
    from scenarios.design.fluorescent_search import SEED_DESIGNS, FluorescentDesign

    rows: dict[str, Any] = {}
    cost: dict[str, float] = {}
    equal: dict[str, float] = {}
    for name, parts in CHALLENGERS.items():
        own = comparison.designs.index(FluorescentDesign(*parts))
        seed = comparison.designs.index(SEED_DESIGNS[name])
        price = comparison.designs[own].price_usd
        row: dict[str, Any] = {"design": comparison.designs[own].text, "price_usd": price}
        strict, within = True, True
        for figure in ("lower", "diagonal", "colour"):
            for kind in ("predicted", "simulated"):
                relative, error = comparison.simulated_against(
                    seed, figure, predicted=kind == "predicted"
                )
                row[f"{kind}_{figure}"] = float(relative[own])
                row[f"{kind}_{figure}_error"] = float(error[own])
                if figure != "colour":
                    strict &= bool(relative[own] <= 1.0)
                    within &= bool(relative[own] <= 1.0 + error[own])
        ratio = price / SEED_DESIGNS[name].price_usd
        row["no_less_accurate"], row["equal_within_error"] = strict, within
        rows[name] = row
        if strict and ratio < 1.0:
            cost[name] = ratio
        if within and ratio < 1.0:
            equal[name] = ratio
    return {
        "cheaper": rows, "cheaper_found": bool(cost), "cost_ratio": min(cost.values(), default=1.0),
        "cheaper_within_error": equal,
    }  # fmt: skip


def _thousand(population: Any) -> tuple[float, float]:
    """Time and processor time [s] of 1000 predictions, warm."""
    from scenarios.design.fluorescent import predict_light_subsets
    from scenarios.design.fluorescent_parts import SEED_LIGHTS, assembled
    from twin.fluorescence import FluorescenceProtocol

    subsets = [s for k in range(1, 9) for s in combinations(range(8), k)]
    setups = [assembled(SEED_LIGHTS["L1"], detector) for detector in ("S1", "S2")]
    protocols = [FluorescenceProtocol(repeats=n, white_repeats=n) for n in (3, 10)]
    predict_light_subsets(setups[1], subsets[:4], population, protocols[0])
    begin, used, done = time.perf_counter(), time.process_time(), 0
    for setup in setups:
        for protocol in protocols:
            done += len(subsets)
            predict_light_subsets(setup, subsets, population, protocol)
    share = 1000.0 / done
    return (time.perf_counter() - begin) * share, (time.process_time() - used) * share
