"""Estimators of Donaldson matrices by name."""

from __future__ import annotations

import dataclasses
import difflib
from importlib import import_module
from typing import Any

from estimators.fluorescence.result import FluorescenceEstimator
from twin.errors import InputError
from twin.toml import near_misses

_OURS = {
    "donaldson": ("donaldson", "DonaldsonEstimator", "DonaldsonSettings", {}),
    "donaldson-linear": ("donaldson", "DonaldsonEstimator", "DonaldsonSettings", {"products": 0}),
    "donaldson-quick": ("quick", "DonaldsonQuickEstimator", "DonaldsonQuickSettings", {}),
    "donaldson-learned": ("learned", "DonaldsonLearnedEstimator", "DonaldsonLearnedSettings", {}),
    "gmm-adam": ("adam", "GmmAdamEstimator", "GmmAdamSettings", {}),
    "blasinski": ("blasinski", "BlasinskiEstimator", "BlasinskiSettings", {}),
    "fluorescence-posterior": (
        "posterior", "FluorescencePosteriorEstimator", "FluorescencePosteriorSettings", {},
    ),
}  # fmt: skip


def fluorescence_names() -> tuple[str, ...]:
    """Names of the estimators, sorted."""
    return tuple(sorted(_OURS))


def fluorescence_estimator(name: str, **settings: Any) -> FluorescenceEstimator:
    """Make an estimator; nothing heavy is imported until it estimates.

    Args:
        name: one of `fluorescence_names()`.
        settings: its own options.

    Raises:
        InputError: an unknown name or option, or a value that cannot be.
    """
    if name not in _OURS:
        close = difflib.get_close_matches(name, _OURS)
        raise InputError(
            f'"{name}"', f"one of {', '.join(fluorescence_names())}", place="estimator",
            remedy=f'Did you mean "{close[0]}"?' if close else "",
        )  # fmt: skip
    module_name, kind, options, fixed = _OURS[name]
    module = import_module(f"estimators.fluorescence.{module_name}")
    known = [each.name for each in dataclasses.fields(getattr(module, options))]
    for option in settings:
        if option not in known:
            raise InputError(
                f"the unknown option `{option}` of {name}", f"one of {', '.join(known)}",
                place="estimator.options", remedy=near_misses(option, known),
            )  # fmt: skip
    made: FluorescenceEstimator = getattr(module, kind)(
        getattr(module, options)(**{**fixed, **settings})
    )
    return made
