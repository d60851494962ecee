"""The Bayesian optimiser: optuna's, asked and told in batches."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.spectra import FloatArray

INSTALL = 'Run: pip install "benchtwin[design]"; or set search = "greedy" in the goal.'
BATCH = 25


class Optimiser:
    """Chooses places in a grid so that two numbers become small together.

    Args:
        shape: choices of every decision.
        seed: the same seed and the same answers give the same places.

    Raises:
        InputError: optuna is not installed.
    """

    batch = BATCH

    def __init__(self, shape: Sequence[int], *, seed: int) -> None:
        try:
            optuna: Any = importlib.import_module("optuna")
        except ImportError as error:
            raise InputError(
                f"no optimiser here ({error})", "the library optuna", place="search", remedy=INSTALL
            ) from error
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._decisions = {
            f"{number:02d}": optuna.distributions.CategoricalDistribution(tuple(range(count)))
            for number, count in enumerate(shape)
        }
        sampler = optuna.samplers.TPESampler(seed=seed % (1 << 32), n_startup_trials=4 * BATCH)
        self._study = optuna.create_study(directions=["minimize", "minimize"], sampler=sampler)
        self._open: list[Any] = []

    def ask(self) -> list[int]:
        """The next place."""
        trial = self._study.ask(self._decisions)
        self._open.append(trial)
        return [int(trial.params[name]) for name in self._decisions]

    def tell(self, first: FloatArray, second: FloatArray, possible: NDArray[np.bool_]) -> None:
        """The numbers at the places that were asked for since the last time, in their order.

        Places that are not possible (too expensive) are told as 10 in the second number.
        """
        for trial, a, b, good in zip(self._open, first, second, possible, strict=True):
            self._study.tell(trial, [float(a), float(b) if good else 10.0])
        self._open.clear()
