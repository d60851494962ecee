"""Figures of many candidates: what a search asks, for translucent and for fluorescent materials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from scenarios.design.apparent import Tables
from scenarios.design.bands import View
from scenarios.design.candidate import Candidate, judged_nm
from scenarios.design.colour import Slabs
from scenarios.design.fisher import Information, Predicted, predicted
from scenarios.design.goal import Goal
from scenarios.design.modes import Modes, checked, modes
from scenarios.design.noise import Settings, covariance, minutes
from scenarios.design.optics import Light, Optics
from scenarios.design.parts import Parts
from twin.bench import Bench
from twin.errors import InputError
from twin.spectra import FloatArray

NOISE = "counts, references and lamps"
CHANNELS = "too few channels"
BANDS = "width of the bands"
COLUMN = {"albedo": 0, "sigma_t_relative": 1, "g": 2}
FEWEST_WAVELENGTHS = 4
BLACK_AND_WHITE = 0.47
"""Correlation of the Monte Carlo's errors of black and white, which share their paths: from two
samples' light at 2^15 paths less that at 2^18, 52 values, +-0.1."""


class Predictor(Protocol):
    """Candidates in, figures out: the same of every kind of material."""

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the T figures; smaller is better for each."""
        ...

    def predict(self, candidates: Sequence[Candidate]) -> FloatArray:
        """Figures of N candidates, shape (N, T).

        Raises:
            twin.errors.InputError: a candidate that cannot be.
        """
        ...

    def limits(self, candidate: Candidate) -> dict[str, dict[str, float]]:
        """Share of every input in the variance behind every figure, by target; adds up to 1."""
        ...


@dataclass(frozen=True, eq=False)
class Setting:
    """One bench, before a protocol is chosen.

    Attributes:
        bench: the bench.
        view: of its detector.
        settings: of the references.
        light: of M materials and K thicknesses as it is seen.
        modes: of unit tolerances.
    """

    bench: Bench
    view: View
    settings: Settings
    light: Light
    modes: Modes

    @property
    def wavelength_nm(self) -> FloatArray:
        """Judged wavelengths [nm], (W,)."""
        return self.view.wavelength_nm


class TranslucentPredictor:
    """Uncertainty of albedo, extinction and anisotropy by Fisher information.

    A figure is the root mean square over the judged wavelengths, of the worst material.

    Args:
        goal: materials, targets, protocol.
        parts: all that may be used.

    Raises:
        InputError: a tolerance that the fast engine does not see.
    """

    def __init__(self, goal: Goal, parts: Parts) -> None:
        self.goal, self.parts = goal, parts
        self.targets = goal.targets.names
        self.media = goal.media
        self.optics = Optics(self.media, goal.protocol.thickness_mm)
        names: dict[str, None] = {}
        for part in parts.by_name.values():
            names |= dict.fromkeys(each.name for each in part.tolerances)
        self.common, self.private = checked(tuple(names))
        self._settings: dict[tuple[object, ...], Setting] = {}
        self._tables = Tables(self.optics)
        self._information: dict[tuple[object, ...], Information] = {}
        self._slabs: dict[bytes, Slabs] = {}

    def predict(self, candidates: Sequence[Candidate]) -> FloatArray:
        """Figures of N candidates, shape (N, T).

        Raises:
            InputError: a candidate that cannot be.
        """
        figures = np.empty((len(candidates), len(self.targets)))
        groups: dict[tuple[object, ...], list[int]] = {}
        for number, each in enumerate(candidates):
            key = (*self.setting(each).light.value.shape, len(each.thickness_mm),
                   self.setting(each).wavelength_nm.tobytes())  # fmt: skip
            groups.setdefault(key, []).append(number)
        for numbers in groups.values():
            own = [candidates[number] for number in numbers]
            figures[numbers] = self._figures(own, self.of(own))
        return figures

    def of(self, candidates: Sequence[Candidate], extra: FloatArray | None = None) -> Predicted:
        """Covariances and gains of candidates with one set of wavelengths.

        Args:
            candidates: with equally many samples.
            extra: standard errors of the captures on top, such as those of a Monte Carlo's light,
                (M, K, W, 3).

        Raises:
            InputError: a candidate that cannot be.
        """
        place = {mm: k for k, mm in enumerate(self.optics.thickness_mm)}
        return predicted(
            [self.information(each, extra) for each in candidates],
            [[place[mm] for mm in each.thickness_mm] for each in candidates],
            [self.scales(each) for each in candidates],
        )

    def scales(self, candidate: Candidate) -> FloatArray:
        """Tolerances of a candidate in the order of the modes, (Q + P,)."""
        known = candidate.tolerances(self.parts)
        return np.array([known.get(name, 0.0) for name in (*self.common, *self.private)])

    def setting(self, candidate: Candidate) -> Setting:
        """The candidate's bench with its light and modes; kept.

        Raises:
            InputError: parts that make no bench, or a detector that sees too few of the
                wavelengths.
        """
        chosen = candidate.chosen(self.parts)
        deciding = tuple(part.name for part in chosen if part.bench or part.brightness != 1.0)
        key = (deciding, candidate.acceptance_deg, candidate.polar_deg)
        if key not in self._settings:
            self._settings[key] = self._set_up(candidate, deciding)
        return self._settings[key]

    def _set_up(self, candidate: Candidate, deciding: Sequence[str]) -> Setting:
        grid = self.goal.wavelength
        bench = candidate.bench(self.parts, grid.wavelength_nm.tolist())
        wavelength = judged_nm(bench, grid.start_nm, grid.stop_nm)
        if len(wavelength) < FEWEST_WAVELENGTHS:
            raise InputError(
                f"{len(wavelength)} pixels of the detector from {grid.start_nm:g} to"
                f" {grid.stop_nm:g} nm", f"{FEWEST_WAVELENGTHS} or more", place="wavelength",
            )  # fmt: skip
        settings, view = Settings.of(bench, wavelength), View.of(bench, wavelength)
        light = view.light(self.optics, bench)
        names = {
            each.name
            for part in self.parts.by_name.values()
            if part.name in deciding or not (part.bench or part.brightness != 1.0)
            for each in part.tolerances
        }
        own = modes(
            tuple(name for name in (*self.common, *self.private) if name in names),
            self.optics, bench, settings, light, view,
        )  # fmt: skip
        return Setting(bench, view, settings, light, self._all(own))

    def _all(self, own: Modes) -> Modes:
        """Modes of all names, those that cannot happen here zero."""
        names = (*self.common, *self.private)
        array = np.zeros((*own.array.shape[:-1], len(names)))
        for column, name in enumerate((*own.common, *own.private)):
            array[..., names.index(name)] = own.array[..., column]
        return Modes(self.common, self.private, array)

    def information(self, candidate: Candidate, extra: FloatArray | None = None) -> Information:
        """Information of every single sample on the candidate's bench by its protocol; kept.

        Args:
            candidate: of which.
            extra: standard errors of the captures on top, shape (M, K, W, 3).

        Raises:
            InputError: a candidate that cannot be.
        """
        setting = self.setting(candidate)
        key: tuple[object, ...] = (id(setting), candidate.averages, candidate.repeats)
        if setting.view.bands is not None:
            # what an estimate makes of bands depends on all that it weighs with
            key = (*key, candidate.thickness_mm, self.scales(candidate).tobytes())
        if extra is None and key in self._information:
            return self._information[key]
        noise = covariance(
            setting.settings, setting.light.value, averages=candidate.averages,
            repeats=candidate.repeats,
        )  # fmt: skip
        if extra is not None:
            place = np.arange(3)
            noise[..., place, place] += extra**2
            shared = BLACK_AND_WHITE * extra[..., 0] * extra[..., 1]
            noise[..., 0, 1] += shared
            noise[..., 1, 0] += shared
        light: Light = setting.light
        shift: FloatArray | None = None
        if setting.view.bands is not None:
            chosen = [self.optics.thickness_mm.index(mm) for mm in candidate.thickness_mm]
            moved = setting.modes.array * self.scales(candidate)
            light, shift = self._tables.estimated(
                setting.bench, setting.view, light, noise, moved, len(self.common), chosen
            )
        material = np.array([medium.at(setting.wavelength_nm) for medium in self.media])
        found = Information.of(
            light, noise, setting.modes, material, np.array(self.optics.thickness_mm), shift
        )
        if extra is None:
            self._information[key] = found
        return found

    def minutes(self, candidate: Candidate) -> float:
        """Time [min] that the visit takes, of the slowest material."""
        setting = self.setting(candidate)
        chosen = [self.optics.thickness_mm.index(mm) for mm in candidate.thickness_mm]
        each = minutes(
            setting.settings, setting.light.value, averages=candidate.averages,
            repeats=candidate.repeats,
        )  # fmt: skip
        return float(each[:, chosen].sum(axis=1).max())

    def slabs(self, wavelength_nm: FloatArray) -> Slabs:
        """The slabs whose colours are predicted, for a detector's wavelengths [nm] (W,); kept."""
        key = wavelength_nm.tobytes()
        if key not in self._slabs:
            self._slabs[key] = Slabs.of(self.media, wavelength_nm)
        return self._slabs[key]

    def scale(self, name: str, wavelength_nm: FloatArray) -> FloatArray:
        """What a figure is relative to: sigma_t [1/mm] of "sigma_t_relative", else 1, (M, W)."""
        material = np.array([medium.at(wavelength_nm) for medium in self.media])
        return material[..., 1] if name == "sigma_t_relative" else np.ones(material.shape[:2])

    def _figures(self, candidates: Sequence[Candidate], found: Predicted) -> FloatArray:
        wavelength = self.setting(candidates[0]).wavelength_nm
        columns = []
        for name in self.targets:
            if name == "de2000":
                columns.append(self.slabs(wavelength).de2000(found).max(axis=-1))
                continue
            own = found.error[..., COLUMN[name]] / self.scale(name, wavelength)
            columns.append(np.sqrt(np.mean(own**2, axis=-1)).max(axis=-1))
        return np.stack(columns, axis=-1)

    def limits(self, candidate: Candidate) -> dict[str, dict[str, float]]:
        """Share of every input in the variance behind every figure, by target; adds up to 1.

        Of the material that is worst in it.
        """
        found = self.of([candidate])
        wavelength = self.setting(candidate).wavelength_nm
        shares: dict[str, dict[str, float]] = {}
        for name in self.targets:
            if name == "de2000":
                slabs = self.slabs(wavelength)
                total, parts, bias = slabs.parts(found)
                worst = int(np.argmax(total[0]))
                by_mode, whole = parts[0, worst], total[0, worst] ** 2
                rest = {CHANNELS: slabs.between[worst] ** 2, BANDS: bias[0, worst]}
            else:
                scale, column = self.scale(name, wavelength), COLUMN[name]
                variance = np.mean((found.error[0, ..., column] / scale) ** 2, axis=-1)
                worst = int(np.argmax(variance))
                gain = found.gain[0, worst, :, column] / scale[worst][:, None]
                by_mode, whole = np.mean(gain**2, axis=0), variance[worst]
                bias = found.bias[0, worst, :, column] / scale[worst]
                rest = {BANDS: np.mean(bias**2)}
            rest[NOISE] = whole - by_mode.sum() - sum(rest.values())
            own: dict[str, float] = {}
            for label, value in zip(found.modes, by_mode, strict=True):
                short = label.partition(" #")[0]
                own[short] = own.get(short, 0.0) + float(value / whole)
            own |= {label: float(value / whole) for label, value in rest.items()}
            shares[name] = dict(
                sorted(((n, s) for n, s in own.items() if s > 0), key=lambda each: -each[1])
            )
        return shares
