"""fiToolbox's own simulated captures, as an acceptance test of the forward model.

Blasinski, Farrell, Wandell 2020 ("Simultaneous surface reflectance and fluorescence spectra
estimation", IEEE TIP 29) publish captures of 24 patches under 14 LEDs through 8 filters. Their
captures count photons, with matrices in photons; ours take energy:

    gain * step * C' (diag(r) + D) L_photon = gain * step * (C E)' (diag(r) + D_energy) L_energy,
    E = diag(lambda) / (h c),  L_photon = E L_energy,  D_energy[out, in] = D[out, in] in / out
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import InputError
from twin.fluorescence.donaldson import from_photons
from twin.fluorescence.system import FluorescenceSystem

SIMULATED = "McNamara-Boswell_4x6x1_qe_0.10.mat"
_PLANCK_J_S, _LIGHT_M_PER_S = 6.62607015e-34, 299_792_458.0


def fitoolbox_max_relative_error(folder: str | Path) -> float:
    """Greatest error of our captures of fiToolbox's patches, relative to the greatest capture.

    Of the reflected and of the fluorescent part of each patch, illuminant and filter: the greatest
    difference over the greatest value of that part and patch.

    Args:
        folder: the folder with illuminants.mat, filters.mat, qe.mat and the simulated set.

    Raises:
        InputError: a file is missing or is not what it should be.
    """
    folder = Path(folder)
    simulated = _load(folder / SIMULATED)
    try:
        wave = simulated["wave"].ravel().astype(np.float64)
        gain = np.asarray(simulated["cameraGain"], dtype=np.float64)
        led, filters, camera = (
            _load(folder / name) for name in ("illuminants.mat", "filters.mat", "qe.mat")
        )
        power = _sampled(led, wave)
        channels = _sampled(filters, wave) * _sampled(camera, wave)
        reflectance = np.asarray(simulated["reflRef"], dtype=np.float64)
        matrices = [np.asarray(each, dtype=np.float64) for each in simulated["dMatRef"].ravel()]
        wanted = {
            "reflected": np.asarray(simulated["reflValsRef"], dtype=np.float64),
            "fluorescent": np.asarray(simulated["flValsRef"], dtype=np.float64),
        }
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(
            f"a file without its variables ({error})", "fiToolbox's data", file=folder
        ) from error
    photons_per_joule = 1e-9 * wave / (_PLANCK_J_S * _LIGHT_M_PER_S)
    step = wave[1] - wave[0]
    system = FluorescenceSystem(
        power.T, step * (channels * photons_per_joule[:, None]).T, wave, wave
    )
    worst = 0.0
    for patch, photons in enumerate(matrices):
        cells = {
            "reflected": np.diag(reflectance[:, patch]),
            "fluorescent": from_photons(photons, wave, wave),
        }
        for part, matrix in cells.items():
            captures = gain * system.captures(matrix).T
            target = wanted[part][:, :, patch]
            worst = max(worst, float(np.abs(captures - target).max() / np.abs(target).max()))
    return worst


def _load(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        return dict(loadmat(str(path)))
    except FileNotFoundError as error:
        raise InputError("no such file", "a file of fiToolbox", file=path) from error
    # scipy's loadmat raises NotImplementedError for a file of MATLAB 7.3, which is HDF5.
    except (ValueError, TypeError, OSError, NotImplementedError) as error:
        raise InputError(
            f"a file that cannot be read ({error})", "a file of fiToolbox", file=path
        ) from error


def _sampled(table: dict[str, Any], wave: Any) -> Any:
    """Columns of a table at the wavelengths of the set, shape (W, columns)."""
    wavelength = table["wavelength"].ravel().astype(np.float64)
    data = np.asarray(table["data"], dtype=np.float64)
    return np.stack([np.interp(wave, wavelength, column) for column in data.T], axis=1)
