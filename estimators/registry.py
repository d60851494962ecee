"""Estimators by name: ours, and those that other packages announce.

Another package announces an estimator in its pyproject.toml:

    [project.entry-points."benchtwin.estimators"]
    mine = "mine.fit:make"

where `make(model: BenchModel, **settings) -> Estimator`.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from estimators.protocol import BenchModel, Estimator
from twin.errors import InputError
from twin.toml import near_misses

GROUP = "benchtwin.estimators"
Factory = Callable[..., Estimator]
"""(model: BenchModel, **settings) -> Estimator."""


@dataclasses.dataclass(frozen=True)
class _Entry:
    """Where one of our estimators lives: loaded when it is asked for."""

    module: str
    estimator: str
    settings: str
    make: str = ""
    """Class method of the settings that makes them; "" calls the class itself."""

    def options(self) -> frozenset[str]:
        """Names of its settings."""
        kind = getattr(import_module(self.module), self.settings)
        return frozenset(field.name for field in dataclasses.fields(kind))

    def __call__(self, model: BenchModel, **settings: Any) -> Estimator:
        """Make the estimator."""
        module = import_module(self.module)
        kind = getattr(module, self.settings)
        made = (getattr(kind, self.make) if self.make else kind)(**settings)
        estimator: Estimator = getattr(module, self.estimator)(model, made)
        return estimator


_OURS: dict[str, _Entry] = {
    "beer": _Entry("estimators.beer", "BeerEstimator", "BeerSettings"),
    "least-squares": _Entry(
        "estimators.least_squares", "LeastSquaresEstimator", "LeastSquaresSettings"
    ),
    "lut": _Entry("estimators.lut", "LutEstimator", "LutSettings"),
    "posterior": _Entry("estimators.posterior", "PosteriorEstimator", "PosteriorSettings"),
    "lut-seed": _Entry("estimators.lut", "LutEstimator", "LutSettings", "of_the_seed"),
    "kubelka-munk": _Entry(
        "estimators.kubelka_munk", "KubelkaMunkEstimator", "KubelkaMunkSettings"
    ),
    "nelder-mead": _Entry("estimators.optimisers", "NelderMeadEstimator", "SearchSettings"),
    "powell": _Entry("estimators.optimisers", "PowellEstimator", "SearchSettings"),
    "adam": _Entry("estimators.optimisers", "AdamEstimator", "AdamSettings"),
}


def names() -> tuple[str, ...]:
    """Names of all estimators, sorted."""
    return tuple(sorted({*_OURS, *_announced()}))


def estimator(name: str, model: BenchModel, **settings: Any) -> Estimator:
    """Make an estimator.

    Args:
        name: one of `names()`.
        model: what is known of the bench.
        settings: the estimator's own options.

    Raises:
        InputError: an unknown name or option, an announced estimator that cannot be loaded or
            is none.
    """
    announced = _announced()
    if name in _OURS:
        factory: Any = _OURS[name]
    elif name in announced:
        try:
            factory = announced[name].load()
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"an estimator that cannot be loaded ({error})",
                f"a function at {announced[name].value}",
                place=name,
                remedy="Install its package again.",
            ) from error
    else:
        close = difflib.get_close_matches(name, names())
        raise InputError(
            f'"{name}"',
            f"one of {', '.join(names())}",
            place="estimator",
            remedy=f'Did you mean "{close[0]}"?' if close else "",
        )
    known = _OURS[name].options() if name in _OURS else None
    for option in settings:
        if known is not None and option not in known:
            raise InputError(
                f"the unknown option `{option}` of {name}",
                f"one of {', '.join(sorted(known))}",
                place="estimator.options",
                remedy=near_misses(option, sorted(known)),
            )
    try:
        made = factory(model, **settings)
    except TypeError as error:
        raise InputError(
            f"options {', '.join(settings) or 'none'} ({error})",
            "options that this estimator has",
            place=name,
        ) from error
    if not isinstance(made, Estimator):
        raise InputError(f"a {type(made).__name__}", "an object with name and estimate", place=name)
    return made


def _announced() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP) if point.name not in _OURS}
