"""What is measured: spectra under every LED, over both backgrounds, and the collimated capture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray


@dataclass(frozen=True, eq=False)
class LedMeasurement:
    """One visit with L lights, S samples, W wavelengths.

    Attributes:
        wavelength_nm: [nm], increasing, (W,).
        lights: spectral power per nm of every light on the reference plane, as the white
            reference told it, in units of its own peak, (L, W).
        signal: the sample's light in the same units, as a perfect diffuser in the reference
            plane would send it: lights times the radiance factor, plus what is emitted,
            (L, S, 2, W): black, white.
        collimated: relative intensity of the beam, (S, W).
        signal_variance, lights_variance, collimated_variance: of independent noise.
        level: relative standard deviation of the lamp's level between two captures.
        light_se: standard error of the simulated light itself, of the radiance factors black
            and white, shared by all lights, (S, 2, W); None for a real visit.
    """

    wavelength_nm: FloatArray
    lights: FloatArray
    signal: FloatArray
    collimated: FloatArray
    signal_variance: FloatArray
    lights_variance: FloatArray
    collimated_variance: FloatArray
    level: float = 0.0
    light_se: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check shapes.

        Raises:
            InputError: shapes that do not belong together, values that are not finite, or a
                variance that is not above 0.
        """
        lights, waves = self.lights.shape if self.lights.ndim == 2 else (0, 0)
        samples = len(self.collimated)
        shapes = {
            "wavelength_nm": (waves,),
            "signal": (lights, samples, 2, waves),
            "collimated": (samples, waves),
            "signal_variance": (lights, samples, 2, waves),
            "lights_variance": (lights, waves),
            "collimated_variance": (samples, waves),
        }
        if self.light_se is not None:
            shapes["light_se"] = (samples, 2, waves)
        for name, shape in shapes.items():
            values = np.asarray(getattr(self, name))
            if not lights or values.shape != shape or not np.isfinite(values).all():
                raise InputError(
                    f"shape {values.shape}, or values that are not finite",
                    f"finite values of shape {shape}",
                    place=name,
                )
            if name in ("signal_variance", "collimated_variance") and np.any(values <= 0.0):
                raise InputError("a variance of 0 or below", "variances above 0", place=name)

    @property
    def values(self) -> FloatArray:
        """All data in one vector, (N,): signal, then collimated."""
        return np.concatenate([self.signal.ravel(), self.collimated.ravel()])

    def covariance(
        self,
        engine: float = 0.0,
        expected: FloatArray | None = None,
        emitted: FloatArray | None = None,
        emission: float = 0.0,
    ) -> FloatArray:
        """Covariance of `values`, (N, N).

        Noise of the shots; noise of each light's spectrum, which all of its captures share; the
        lamp's level in each capture and in each reference; the engine's own relative error,
        one for every sample and background and shared by all lights and wavelengths.

        Args:
            engine: relative standard error of the forward engine.
            expected: the data without noise as a model has them, (N,), for what is proportional
                to them. Noisy data in its place pull a fit down, the more so the more of them
                share an error (Peelle 1987; D'Agostini 1994, Nucl. Instrum. Methods A 346, 306);
                None leaves these shared errors out.
            emitted: the fluorescent part of the expected signal, (L, S, 2, W).
            emission: the engine's relative standard error of it, one for every sample and
                background.
        """
        lights, samples, backgrounds, waves = self.signal.shape
        total = np.diag(
            np.concatenate([self.signal_variance.ravel(), self.collimated_variance.ravel()])
        )
        if expected is None:
            return total
        signal = expected[: self.signal.size].reshape(self.signal.shape)
        collimated = expected[self.signal.size :].reshape(self.collimated.shape)
        lit = self.lights > 1e-3 * self.lights.max(axis=1, keepdims=True)
        factor = np.where(lit[:, None, None], signal, 0.0)
        factor = factor / np.where(lit, self.lights, 1.0)[:, None, None]
        index = np.arange(self.signal.size).reshape(self.signal.shape)

        def add(where: np.ndarray, mode: FloatArray) -> None:
            total[np.ix_(where, where)] += np.outer(mode, mode)

        for number in range(lights):
            spread = factor[number] * np.sqrt(self.lights_variance[number])
            for w in range(waves):
                add(index[number, :, :, w].ravel(), spread[:, :, w].ravel())
            add(index[number].ravel(), self.level * signal[number].ravel())
            for s in range(samples):
                for b in range(backgrounds):
                    add(index[number, s, b], self.level * signal[number, s, b])
        for s in range(samples):
            for b in range(backgrounds):
                add(index[:, s, b].ravel(), engine * signal[:, s, b].ravel())
                if emitted is not None:
                    add(index[:, s, b].ravel(), emission * emitted[:, s, b].ravel())
                if self.light_se is not None:
                    for w in range(waves):
                        add(index[:, s, b, w], self.lights[:, w] * self.light_se[s, b, w])
            own = self.signal.size + s * waves + np.arange(waves)
            add(own, engine * collimated[s])
            add(own, self.level * collimated[s])
        return total

    def reduced(self, lights: slice, samples: slice, backgrounds: slice) -> LedMeasurement:
        """The part of the visit with some lights and samples; both backgrounds stay in shape.

        A background that is left out keeps its place with a variance that says nothing.
        """
        variance = np.full_like(self.signal_variance, 1e6)
        variance[:, :, backgrounds] = self.signal_variance[:, :, backgrounds]
        return LedMeasurement(
            self.wavelength_nm,
            self.lights[lights],
            self.signal[lights][:, samples],
            self.collimated[samples],
            variance[lights][:, samples],
            self.lights_variance[lights],
            self.collimated_variance[samples],
            self.level,
            None if self.light_se is None else self.light_se[samples],
        )
