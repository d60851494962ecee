"""How far a gap really shrinks, now that its true response is known."""

from __future__ import annotations

import numpy as np

from scenarios.blind.answers import Record


def regret(record: Record) -> float | None:
    """Closure of one who knew the effects, less that of the diagnosis; None where neither is known.

    Both are judged on the same splits. The oracle's was computed for every leading hypothesis
    before the opening; of a truth that was not among them it is 1 less what fitting its value to
    noise costs.
    """
    found = record.outcome["closure"]
    if found is None or found["value"] is None:
        return None
    truth = set(record.truth)
    for oracle in record.outcome["oracles"]:
        if set(oracle["effects"]) == truth and oracle["value"] is not None:
            return float(oracle["value"]) - float(found["value"])
    if not found["before"] or found["before"] <= 0.0:
        return None
    return 1.0 - float(found["oracle_floor"]) / float(found["before"]) - float(found["value"])


def true_closure(record: Record) -> float | None:
    """What the stated interval is about, free of the judging data's noise.

    With t the reduced response of the world, M the chosen effects' columns, B the directions that
    are judged, v the values that a fit to t finds and f the chi-square that fitting them to noise
    costs on average: G = 1 - (|B'(t - M v)|^2 + f) / |B't|^2. M are slopes at the fit, as the
    diagnosis judges: of t the part that the fitted effects explain is taken along these slopes.
    """
    judged = record.outcome["judged"]
    response = np.array(record.label["response"])
    if judged is None or not response.size:
        return None
    shape = (response.shape[0], -1)
    signal = response.reshape(shape) - np.array(judged["explained"])
    fitted = np.array(judged["value"])
    along = np.tensordot(np.array(judged["along"]), signal, axes=([1, 2], [0, 1]))
    inner = np.tensordot(np.array(judged["inner"]), signal, axes=([1, 2], [0, 1]))
    along = along + np.array(judged["moved"]) @ fitted
    inner = inner + np.array(judged["gram"]) @ fitted
    value = np.linalg.lstsq(np.array(judged["gram"]), inner, rcond=1e-9)[0]
    left = along - np.array(judged["moved"]) @ value
    total = float(along @ along)
    if total <= 0.0:
        return None
    return 1.0 - (float(left @ left) + float(judged["oracle_floor"])) / total
