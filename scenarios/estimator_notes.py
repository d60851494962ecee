"""One line about every estimator: what it is, and where it is valid."""

from __future__ import annotations

NOTES = {
    "least-squares": "fit of the fast engine to all captures, with covariance: the first choice"
    " where the bench is as described",
    "posterior": "draws from the posterior of the fast engine: where intervals are wide or skewed,"
    " or inputs are uncertain; slower",
    "lut": "look-up in the Monte Carlo map of the whole bench: captures inside the map, g not near"
    " its ends",
    "lut-seed": "the look-up of Iser et al. 2022: fixed neighbourhood, so its spread is no"
    " measured uncertainty",
    "beer": "Beer's law on the collimated capture: extinction coefficient only, where little"
    " scattered light reaches the detector",
    "kubelka-munk": "closed form of two backgrounds: thick, weakly absorbing samples; g is a rough"
    " guess, the noise alone is stated",
    "nelder-mead": "simplex search on the sum of squares of least-squares: for comparison, valid"
    " where that is",
    "powell": "direction-set search on the sum of squares of least-squares: for comparison, valid"
    " where that is",
    "adam": "gradient descent on the sum of squares of least-squares: for comparison, valid where"
    " that is",
}


def note(name: str) -> str:
    """The line about one estimator of the registry; for another package's, who announces it."""
    if name in NOTES:
        return NOTES[name]
    from importlib.metadata import entry_points

    from estimators.registry import GROUP

    found = entry_points(group=GROUP, name=name)
    if not found:
        return "of an unknown package"
    point = next(iter(found))
    maker = point.dist.name if point.dist is not None else "another package"
    return f"announced by {maker} ({point.value})"
