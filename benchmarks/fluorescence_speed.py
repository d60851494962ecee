"""Processor time of one Donaldson matrix: ours against the published fit, on one core.

The times of `python -m benchmarks fluorescence` alone, in a minute: warm, one material at a time,
the median over twelve generated materials, the slowest of the four set-ups. The network of
`donaldson-learned` is trained on few draws: its time does not depend on what it has learned.

- `seconds_per_material`: `donaldson`; `..._linear`, `..._quick`, `..._learned` the others;
  `by_setup` each of them [s].
- `adam_seconds`: the published fit compiled as one program; `adam_loop_seconds` with its gradient
  compiled and its loop in Python, as published.
- `speed_ratio_adam` and `..._linear`, `..._quick`, `..._learned`: the first over ours;
  `speed_ratio_adam_loop`: the second over `donaldson`.
"""

from __future__ import annotations

import sys
from typing import Any

from benchmarks.fluorescence import SETUPS, processor_seconds

MATERIALS = 12


def run(quick: bool) -> dict[str, Any]:
    """The keys above; quick: one set-up."""
    from estimators.fluorescence.adam import GmmAdamEstimator, GmmAdamSettings
    from estimators.fluorescence.donaldson import DonaldsonEstimator, DonaldsonSettings
    from estimators.fluorescence.learned import DonaldsonLearnedEstimator, DonaldsonLearnedSettings
    from estimators.fluorescence.quick import DonaldsonQuickEstimator
    from scenarios.design.fluorescent_population import fluorescent_population
    from scenarios.figures.fluorescence_runs import captures

    truths = list(fluorescent_population(MATERIALS, seed=11))
    methods: dict[str, Any] = {
        "": DonaldsonEstimator(),
        "_linear": DonaldsonEstimator(DonaldsonSettings(products=0, draws=0)),
        "_quick": DonaldsonQuickEstimator(),
        "_learned": DonaldsonLearnedEstimator(
            DonaldsonLearnedSettings(materials=2000, epochs=1, keep=False)
        ),
        "adam": GmmAdamEstimator(),
        "adam_loop": GmmAdamEstimator(GmmAdamSettings(whole_program=False)),
    }
    times: dict[str, dict[str, float]] = {}
    for name in SETUPS[:1] if quick else SETUPS:
        data = captures(name, truths, seed=1)
        times[name] = {
            key: processor_seconds(each, data[:2] if key == "adam_loop" else data)
            for key, each in methods.items()
        }
        print(name, file=sys.stderr, flush=True)
    slowest = {key: max(each[key] for each in times.values()) for key in methods}
    ours = [key for key in methods if not key.startswith("adam")]
    return {
        **{f"seconds_per_material{key}": slowest[key] for key in ours},
        "adam_seconds": slowest["adam"], "adam_loop_seconds": slowest["adam_loop"],
        **{f"speed_ratio_adam{key}": slowest["adam"] / slowest[key] for key in ours},
        "speed_ratio_adam_loop": slowest["adam_loop"] / slowest[""],
        "by_setup": {
            name: {key or "donaldson": value for key, value in each.items()}
            for name, each in times.items()
        },
    }  # fmt: skip
