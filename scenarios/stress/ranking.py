"""Which estimator is the best: one figure from the errors in all three parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from scenarios.stress.score import PARAMETERS, Score


def ranking(scores: Mapping[str, Score]) -> list[dict[str, Any]]:
    """Estimators from the best to the worst.

    The figure is the geometric mean over albedo, sigma_t and g of the median absolute error over
    all points (one without a value counts as infinite), each in units of the best estimator's:
    1 is best in everything. An estimator that leaves a parameter out comes last.
    """
    best = {
        name: min((s.parameters[name].median_error_all for s in scores.values()), default=math.inf)
        for name in PARAMETERS
    }
    rows = []
    for title, score in scores.items():
        ratios = [
            _ratio(score.parameters[name].median_error_all, best[name]) for name in PARAMETERS
        ]
        finite = all(math.isfinite(ratio) for ratio in ratios)
        rows.append(
            {
                "estimator": title,
                "error_ratio": math.prod(ratios) ** (1 / len(ratios)) if finite else math.inf,
                "intervals": {n: score.parameters[n].verdict for n in PARAMETERS},
                "overconfident": score.overconfident.value,
                "answered": score.answered / score.points,
            }
        )
    return sorted(rows, key=lambda row: (row["error_ratio"], row["estimator"]))


def _ratio(value: float, best: float) -> float:
    if value == best:
        return 1.0 if math.isfinite(best) else math.inf
    return value / best if best > 0 else math.inf
