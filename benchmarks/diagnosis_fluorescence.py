"""Diagnosis of fluorescence visits: false alarms, effects found, intervals, on the four set-ups.

Visits are disturbed by code of their own (`tests.diagnosis.fluorescence_visits`: formulas of LEDs
and bands, not the catalogue's interpolation). Nothing wrong: eight example materials and the six
measured matrices of the data folder, where it is there; these have rows and cells that no smooth
prior expects. One effect: ten (chip) or eight (spectrometer) disturbances, each of two example
materials.

- `false_alarms`, `visits_without_gap`: verdicts other than "no gap", of how many.
- `found`, `visits_with_effect`: the right effect alone leads; by set-up too.
- `inside_90`, `intervals`: values inside the 90 % interval, of how many that are given.
- `alarms`, `missed`: each of the others, with verdict and what leads.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from benchmarks.fluorescence import DATA, SETUPS, measured

LIGHTS: tuple[tuple[str, int, float], ...] = (
    ("illuminant_shift", 0, 2.0), ("illuminant_shift", -1, 6.0), ("illuminant_shift", 3, -2.0),
    ("filter_leak", 2, 0.02), ("filter_leak", 4, 0.05), ("ultraviolet_leak", 6, 0.03),
    ("cross_talk", 0, 0.03), ("cross_talk", 0, 0.09),
)  # fmt: skip
CHANNELS: tuple[tuple[str, int, float], ...] = (
    ("sensitivity_error", 3, -2.0), ("sensitivity_error", 5, 2.0),
)  # fmt: skip


def run(quick: bool) -> dict[str, Any]:
    """The keys above; quick: one set-up, every third visit."""
    from diagnosis.fluorescence import diagnosed_fluorescence
    from tests.diagnosis.fluorescence_visits import visit
    from twin.fluorescence import example, named_setup
    from twin.fluorescence.fluorophores import MATERIALS

    names, every = sorted(MATERIALS)[:8], 3 if quick else 1
    path = DATA / "donaldson_bfc450.npz"
    matrices = measured(path) if path.exists() else []
    alarms: list[str] = []
    missed: list[str] = []
    quiet = inside = intervals = 0
    found: dict[str, list[int]] = {}
    begin = time.process_time()
    for name in SETUPS[1:2] if quick else SETUPS:
        setup = named_setup(name)
        own = [example(each, setup.emission_nm, setup.excitation_nm) for each in names]
        for number, matrix in list(enumerate([*own, *matrices]))[::every]:
            _, told = diagnosed_fluorescence(visit(setup, matrix, 100 + number))
            quiet += 1
            if told.verdict != "no_gap":
                alarms.append(f"{name} {matrix.name}: {told.verdict} {told.leading}")
        suspects = LIGHTS + CHANNELS if name.endswith("s2") else LIGHTS
        found[name] = [0, 0]
        cases = [(n, turn, each) for n, each in enumerate(suspects) for turn in (0, 1)]
        for number, turn, (effect, place, value) in cases[::every]:
            matrix = own[(number + 3 * turn) % len(own)]
            _, told = diagnosed_fluorescence(
                visit(setup, matrix, 300 + number + 50 * turn, [(effect, place, value)])
            )
            right = _name(effect, place)
            found[name][0] += told.leading == (right,)
            found[name][1] += 1
            if told.leading != (right,):
                missed.append(f"{name} {right} {value:g}: {told.verdict} {told.leading}")
            for each in told.effects:
                if each.name == right and each.parameters:
                    low, high = each.parameters[0].interval
                    inside, intervals = inside + (low <= value <= high), intervals + 1
        print(f"{name}: {time.process_time() - begin:.0f} s", file=sys.stderr, flush=True)
    return {
        "false_alarms": len(alarms), "visits_without_gap": quiet,
        "found": sum(each[0] for each in found.values()),
        "visits_with_effect": sum(each[1] for each in found.values()),
        "found_by_setup": {name: f"{each[0]} of {each[1]}" for name, each in found.items()},
        "inside_90": inside, "intervals": intervals,
        "alarms": alarms, "missed": missed, "cpu_seconds": time.process_time() - begin,
    }  # fmt: skip


def _name(effect: str, place: int) -> str:
    if effect == "cross_talk":
        return effect
    kind = "channel" if effect == "sensitivity_error" else "illuminant"
    return f"{effect}[{'all' if place < 0 else f'{kind} {place + 1}'}]"
