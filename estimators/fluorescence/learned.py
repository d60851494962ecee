"""The estimator `donaldson-learned`: the posterior mean, learned once for a set-up.

For the first sample of a set-up a network is trained on materials drawn from the prior of
`donaldson` (`learned_draws`, `learned_training`): minutes, and kept on disk. Every further sample
costs about a millisecond: its light levels are brought to those of the network, the network looks,
sees under the sample's own calibration what the captures say beyond its estimate, and looks again.
Other valid captures, other light by more than 5 % or noise of more than four times or less than a
quarter need another network.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from estimators.fluorescence.learned_draws import MaterialPrior
from estimators.fluorescence.learned_network import Network
from estimators.fluorescence.learned_training import train
from estimators.fluorescence.quick import (
    DonaldsonQuickEstimator,
    DonaldsonQuickSettings,
    Gain,
    result_of,
)
from estimators.fluorescence.result import FluorescenceResult
from twin.cache import cache_folder, content_key, load_arrays, store_arrays
from twin.errors import InputError
from twin.fluorescence.system import FluorescenceData
from twin.spectra import FloatArray

Z90 = 1.6448536269514722
"""95 % quantile of the standard normal distribution."""
VERSION = 1
"""Of what is kept on disk: another one where the draws, the network or its training change."""
WIDER = 2.3
"""How much wider the intervals are than the network learns: materials are not quite like the draws.
From the coverage on generated matrices."""


@dataclass(frozen=True, kw_only=True)
class DonaldsonLearnedSettings:
    """Options of the estimator `donaldson-learned`."""

    materials: int = 200_000
    """Drawn materials that a network is trained on; 2 kB of memory each."""
    epochs: int = 20
    """How often each of them is seen, with new noise every time."""
    width: int = 256
    layers: int = 3
    """Of the first look; the second has one."""
    terms: int = 6
    """Products of an emission and an excitation spectrum in the first look."""
    directions: int = 150
    """Most directions of the captures that the network sees."""
    samples: int = 16
    """Most samples of a batch that calibration and noise are averaged over."""
    seed: int = 1
    keep: bool = True
    """Whether networks are kept in the cache folder, where the same captures find them again."""
    prior: MaterialPrior = field(default_factory=MaterialPrior)

    def __post_init__(self) -> None:
        for name, low, high in (
            ("materials", 100, 10**8), ("epochs", 1, 10**4), ("width", 1, 10**4),
            ("layers", 1, 20), ("terms", 1, 100), ("directions", 1, 10**4),
            ("samples", 1, 1000), ("seed", 0, 2**63),
        ):  # fmt: skip
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise InputError(f"{value!r}", f"an integer of {low} to {high}", place=name)


class DonaldsonLearnedEstimator:
    """The posterior mean by a network that is trained once for a set-up.

    Attributes:
        report: told how much of a training is done, of how much; nobody by default.
    """

    report: Callable[[float, float], None]

    def __init__(self, settings: DonaldsonLearnedSettings | None = None) -> None:
        self._settings = settings or DonaldsonLearnedSettings()
        self._plain = {
            k: v if isinstance(v, (int, float)) else str(v)
            for k, v in asdict(self._settings).items()
            if k != "keep"
        }
        self._gains = DonaldsonQuickEstimator(
            DonaldsonQuickSettings(
                samples=self._settings.samples, background=self._settings.prior.background
            )
        )
        self._networks: list[tuple[Gain, Network]] = []
        self.report = _nobody

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        return "donaldson-learned"

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Estimate one matrix, with the network of an earlier sample where it serves.

        Raises:
            InputError: captures that cannot be used.
        """
        return self._one(data, [data])

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several; a network is trained for all samples like the first that needs one.

        Raises:
            InputError: captures that cannot be used.
        """
        return [self._one(one, data) for one in data]

    def _network(self, known: Gain) -> Network:
        for gain, network in self._networks:
            if gain is known:
                return network
        network = self._kept(known) if self._settings.keep else self._trained(known)
        self._networks = [(known, network), *self._networks[:7]]
        return network

    def _kept(self, known: Gain) -> Network:
        """The network for exactly this, from the cache folder or trained and put there."""
        digest = hashlib.sha256()
        system = known.system
        for each in (
            system.illuminants, system.sensitivities, system.emission_nm, system.excitation_nm,
            known.noise, known.valid,
        ):  # fmt: skip
            digest.update(repr(each.shape).encode() + np.ascontiguousarray(each).tobytes())
        key = content_key({"version": VERSION, "of": digest.hexdigest(), "settings": self._plain})
        path = cache_folder("networks") / f"{key}.npz"
        stored = load_arrays(path, lambda text: warnings.warn(text, stacklevel=2))
        if stored is not None:
            return Network.of(stored, known.cells)
        network = self._trained(known)
        try:
            store_arrays(path, network.arrays())
        except InputError as error:  # minutes of training are not lost to a full disk
            warnings.warn(f"the trained network is not kept: {error}", stacklevel=2)
        return network

    def _trained(self, known: Gain) -> Network:
        shape = (-1, known.cells.emission_nm.size * known.cells.excitation_nm.size)
        design = known.system.design().reshape(shape)[known.valid][:, known.places]
        own = self._settings
        return train(
            design, known.noise, known.cells, own.prior, draws=own.materials, epochs=own.epochs,
            width=own.width, layers=own.layers, terms=own.terms, directions=own.directions,
            seed=own.seed, report=self.report,
        )  # fmt: skip

    def _one(
        self, data: FluorescenceData, others: Sequence[FluorescenceData]
    ) -> FluorescenceResult:
        known = self._gains.gain_for(data, others)
        network = self._network(known)
        light, usual = data.system.illuminants, known.system.illuminants
        both = (light * usual).sum(axis=1)
        level = np.where(both > 0.0, (usual**2).sum(axis=1) / np.where(both > 0.0, both, 1.0), 1.0)
        value = data.value.reshape(-1)[known.valid]
        alike = (data.value * level[:, None]).reshape(-1)[known.valid]

        def beyond(unknowns: FloatArray) -> FloatArray:
            return np.asarray(value - known.captured(data.system, unknowns))

        found, wide, size = network.unknowns(alike, beyond)
        np.clip(found, 0.0, known.upper, out=found)
        left = beyond(found)
        chi_square = float(left @ network.inverse[size] @ left)
        wide *= WIDER
        quantile = np.stack([found - wide[0], found, found + wide[1]])
        return result_of(
            self.name, self._plain, data, known, found,
            np.clip(quantile, 0.0, known.upper), wide.sum(axis=0) / (2.0 * Z90), chi_square,
            known.made_from,
        )  # fmt: skip


def _nobody(done: float, total: float) -> None:
    """A report that nobody hears."""
