"""The fluorescent translucent case: what is recovered with and without fluorescence in the model.

Truth: the Monte Carlo of the whole finite bench. With: six narrow and two white LEDs one after
another, black and white backgrounds, two thicknesses and the collimated capture, fitted by
`estimators.translucent_fluorescence`. Without: the seed's measurement, the same sample under the
bench's own lamp, fitted without any fluorescence. Errors are relative; `sigma_a` includes the
dye's absorption; `fluorescence` is the integrated source, which the blind fit misses altogether.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict

from scenarios.fluorescent_translucent import Case, compare, design_table, true_captures

PATHS, CORRECTION_PATHS = 32_768, 8_192
QUICK_PATHS, QUICK_CORRECTION_PATHS = 8_192, 0


def run(quick: bool) -> dict[str, object]:
    """Run the benchmark.

    Args:
        quick: fewer paths, no Monte Carlo correction in the estimator, and no other designs.
    """
    case = Case()
    begun = time.process_time()
    truth = true_captures(
        case,
        paths=QUICK_PATHS if quick else PATHS,
        progress=lambda done, total: print(f"light {done}/{total}", file=sys.stderr),
    )
    traced = time.process_time()
    found = compare(
        case, truth=truth, correction_paths=QUICK_CORRECTION_PATHS if quick else CORRECTION_PATHS
    )
    told = time.process_time()
    own, blind = asdict(found.errors_with), asdict(found.errors_without)
    names = ("sigma_a", "sigma_s_prime", "fluorescence")
    return {
        "error_with": {name: own[name] for name in names},
        "bias_without": {name: blind[name] for name in names},
        "error_with_largest": {name: own[f"{name}_largest"] for name in names[:2]},
        "bias_without_largest": {name: blind[f"{name}_largest"] for name in names[:2]},
        "coverage90": own["coverage"],
        "coverage90_without": blind["coverage"],
        "chi_square_per_degree": found.with_fluorescence.chi_square
        / found.with_fluorescence.degrees,
        "chi_square_per_degree_without": found.without.chi_square / found.without.degrees,
        "designs": {}
        if quick
        else {name: asdict(told_by) for name, told_by in design_table().items()},
        "cpu_seconds_light": traced - begun,
        "cpu_seconds_estimates": told - traced,
    }
