"""The fast engine as the posterior evaluates it: many materials per wavelength, and nuisances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimators.forward import Forward
from estimators.posterior_settings import PosteriorSettings
from estimators.protocol import BenchModel
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.adding_doubling import Parameters

ROWS = 32
"""A program is compiled for a multiple of so many rows, whatever the number of wavelengths."""
QUANTUM = 2.0**-30
"""Captures are rounded to this: their last bits depend on what else is in the batch."""
AHEAD = 16
"""Evaluations handed to the engine before the first is asked back."""
ACCEPTANCE_STEP = 0.01
_DERIVED = {
    "thickness_relative": "thickness_mm",
    "n_sigma": "n",
    "rho_black_relative": "rho_black",
    "rho_white_relative": "rho_white",
}


class Engine:
    """Captures (M = 3 S of them, index 3 * sample + capture) of materials at W wavelengths."""

    def __init__(self, model: BenchModel, wavelengths: Sequence[int] | None = None) -> None:
        """Build the engine.

        Args:
            model: the bench.
            wavelengths: indices of the wavelengths that are wanted; None: all.

        Raises:
            InputError: a bench that the fast engine cannot show.
        """
        self.model = model
        self.wanted = tuple(range(model.wavelength_nm.size) if wavelengths is None else wavelengths)
        rows = -(-max(model.wavelength_nm.size, len(self.wanted)) // ROWS) * ROWS
        self.repeats = max(1, rows // len(self.wanted))
        index = np.resize(np.repeat(self.wanted, self.repeats), rows)
        index[len(self.wanted) * self.repeats :] = self.wanted[0]
        self._rows = index
        self._model = _rows_of(model, index)
        self.forward = Forward.of(self._model)
        self.samples = len(model.sample_names)
        self.size = 3 * self.samples
        self._opened: Forward | None = None
        self._narrow: dict[tuple[int, ...], Engine] = {}

    def narrowed(self, wavelengths: NDArray[np.intp]) -> Engine:
        """An engine of the same shape for some of the wavelengths, evaluated more at a time."""
        key = tuple(self.wanted[w] for w in wavelengths)
        if key not in self._narrow:
            self._narrow = {key: Engine(self.model, key)}
        return self._narrow[key]

    def at(self, materials: FloatArray) -> FloatArray:
        """Captures of K materials per wavelength, (K, W, 3) to (K, W, M)."""
        count, width, _ = materials.shape
        found = np.empty((count, width, self.size))
        turns = [range(k, min(k + self.repeats, count)) for k in range(0, count, self.repeats)]
        for first in range(0, len(turns), AHEAD):
            ahead = turns[first : first + AHEAD]
            running = [self.forward.forward(self._parameters(materials[list(t)])) for t in ahead]
            for turn, value in zip(ahead, running, strict=True):
                rows = np.asarray(value).reshape(-1, self.size)
                block = rows[: width * self.repeats].reshape(width, self.repeats, self.size)
                found[turn.start : turn.stop] = block[:, : len(turn)].transpose(1, 0, 2)
        return _rounded(found)

    def with_jacobian(self, material: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Captures (W, M) and derivatives by (albedo, sigma_t, g), (W, M, 3), of (W, 3)."""
        width = len(material)
        value, slope = self.forward.forward_and_jacobian(self._parameters(material[None]))
        pick = slice(0, width * self.repeats, self.repeats)
        return (
            _rounded(np.asarray(value)[pick].reshape(width, self.size)),
            np.asarray(slope)[pick].reshape(width, self.size, 3),
        )

    def nuisance_slopes(self, materials: FloatArray, settings: PosteriorSettings) -> FloatArray:
        """Change of the captures per standard deviation of every nuisance, (K, W, M, N).

        One column per sample for the thickness, one for every other nuisance that is stated, in
        the order of `nuisance_names`.

        Args:
            materials: (K, W, 3).
            settings: standard deviations.
        """
        stated = settings.stated()
        names = tuple(_DERIVED[name] for name in stated if name in _DERIVED)
        return np.stack([self._slopes(one, names, settings, stated) for one in materials])

    def _slopes(
        self,
        material: FloatArray,
        names: tuple[str, ...],
        settings: PosteriorSettings,
        stated: tuple[str, ...],
    ) -> FloatArray:
        width = len(material)
        pick = slice(0, width * self.repeats, self.repeats)
        parameters = self._parameters(material[None])
        if names:
            value, slope = map(np.asarray, self.forward.forward_and_jacobian(parameters, names))
        else:
            value, slope = np.asarray(self.forward.forward(parameters)), np.empty(0)
        captures = value[pick]
        by = {name: slope[pick][..., k] for k, name in enumerate(names)}
        panels = np.array([1.0, 1.0, 0.0])
        columns: list[FloatArray] = []
        for name in stated:
            sigma = float(getattr(settings, name))
            if name == "thickness_relative":
                thickness = np.asarray(parameters.thickness_mm)
                for s in range(self.samples):
                    column = np.zeros_like(captures)
                    column[:, s] = by["thickness_mm"][:, s] * sigma * thickness[s]
                    columns.append(column)
            elif name == "n_sigma":
                columns.append(by["n"] * sigma)
            elif name in ("rho_black_relative", "rho_white_relative"):
                rho = np.asarray(getattr(parameters, _DERIVED[name]))[pick]
                columns.append(by[_DERIVED[name]] * sigma * rho[:, None, None])
            elif name == "acceptance_relative":
                wider = np.asarray(self._wider().forward(parameters))[pick]
                columns.append((wider - captures) * (sigma / ACCEPTANCE_STEP))
            else:
                light = panels if name == "panel_drift" else 1.0 - panels
                columns.append(captures * light * sigma)
        stacked = np.stack(columns, axis=-1) if columns else np.zeros((*captures.shape, 0))
        return _rounded(stacked.reshape(width, self.size, -1))

    def _wider(self) -> Forward:
        """The engine with a slightly larger acceptance: its derivative is a difference."""
        if self._opened is None:
            bench = self._model.bench
            if bench is None:
                raise InputError("no bench", "a bench", place="model")
            angle = bench.detector.acceptance_deg * (1.0 + ACCEPTANCE_STEP)
            detector = bench.detector.model_copy(update={"acceptance_deg": angle})
            wide = bench.model_copy(update={"detector": detector})
            self._opened = Forward.of(replace(self._model, bench=wide))
        return self._opened

    def _parameters(self, materials: FloatArray) -> Parameters:
        """Full rows for up to `repeats` materials per wavelength, (K, W, 3)."""
        count, width, _ = materials.shape
        rows = np.empty((self._rows.size, 3))
        block = rows[: width * self.repeats].reshape(width, self.repeats, 3)
        block[:, :count] = materials.transpose(1, 0, 2)
        block[:, count:] = materials[:1].transpose(1, 0, 2)
        rows[width * self.repeats :] = materials[0, 0]
        return self.forward.parameters(rows[:, 0], rows[:, 1], rows[:, 2])


def nuisance_names(settings: PosteriorSettings, sample_names: Sequence[str]) -> tuple[str, ...]:
    """Names of the columns of `Engine.nuisance_slopes`."""
    names: list[str] = []
    for name in settings.stated():
        if name == "thickness_relative":
            names += [f"thickness {sample}" for sample in sample_names]
        else:
            names.append(name)
    return tuple(names)


def _rounded(values: FloatArray) -> FloatArray:
    return np.asarray(np.round(values / QUANTUM) * QUANTUM)


def _rows_of(model: BenchModel, index: NDArray[np.intp]) -> BenchModel:
    """The model with the wavelengths of every row."""
    return replace(
        model,
        wavelength_nm=model.wavelength_nm[index],
        n=model.n[:, index],
        rho_black=model.rho_black[index],
        rho_white=model.rho_white[index],
        covers_above=tuple(cover[index] for cover in model.covers_above),
        covers_below=tuple(cover[index] for cover in model.covers_below),
    )
