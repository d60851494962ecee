"""Where the energy of light of one wavelength goes in a fluorescent stack, by a forward walk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bench import Bench, Sample
from twin.bispectral.engine import (
    _MODULES,
    BLOCKS,
    _warp,
    dyes_of,
    fluorescent_stacks,
    problem_of,
    stacked,
)
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.bispectral.medium import FluorescentProperties

SHARES = (
    "host", "heat", "reflected", "transmitted", "lost", "fluoresced_up", "fluoresced_down",
)  # fmt: skip
STREAM = 11


@dataclass(frozen=True)
class Ledger:
    """Shares of the energy of light that lands on the axis, without a background.

    Attributes:
        share: by name: absorbed by the host; turned to heat by the fluorophores (what is not
            re-emitted, and the Stokes loss); reflected and transmitted at the light's own
            wavelength; lost at the sides; fluoresced and escaped upwards and downwards.
        share_se: standard errors of the shares.
        total, total_se: sum of all shares and its standard error; 1 when the walk is right.
        fluence, fluence_se: fluence per irradiance by depth from the top, bins of equal
            thickness, before any re-emission, and standard errors, (bins,).
    """

    share: dict[str, float]
    share_se: dict[str, float]
    total: float
    total_se: float
    fluence: FloatArray
    fluence_se: FloatArray


def energy_ledger(
    bench: Bench,
    sample: Sample,
    properties: FluorescentProperties,
    wave_in: int,
    *,
    cosines: tuple[float, ...] = (1.0,),
    shares: tuple[float, ...] = (1.0,),
    bins: int = 16,
    paths: int = 65_536,
    seed: int = 0,
    device: str | None = None,
    extinction: FloatArray | None = None,
) -> Ledger:
    """Energy balance and depth profile of light of wavelength index `wave_in` from above.

    Args:
        bench: covers and lateral size; there is no background.
        sample: thickness and index.
        properties: of `fluorescent_properties`.
        wave_in: index of the exciting wavelength.
        cosines: in air, of the light's directions.
        shares: of the irradiance, by direction.
        bins: of the depth profile.
        paths: number of paths.
        seed: the same seed gives the same bytes.
        device: Warp device; None takes a GPU if there is one.
        extinction: [1/mm], (W,), in place of the medium's own: a walk that is wrong, for tests.
    """
    from dataclasses import replace

    from twin.transport import mean_and_error, panels_setup
    from twin.transport.engine import default_device

    wp = _warp()
    where = device or default_device()
    stacks = fluorescent_stacks(bench, sample, properties)
    if extinction is not None:
        for w, stack in enumerate(stacks):
            sigma = stack.sigma_t.copy()
            sigma[stack.counted] = extinction[w]
            stacks[w] = replace(stack, sigma_t=sigma)
    setup = panels_setup(bench, stacks[0].height)
    count = len(properties.wavelength_nm)
    nothing = np.zeros(count)
    emitted = properties.step_nm[:, None] * properties.source
    cumulated = np.cumsum(emitted, axis=0).T
    total = cumulated[:, -1]
    sigma = properties.sigma_t_per_mm

    def array(values: Any) -> Any:
        return wp.array(np.asarray(values, dtype=np.float32), dtype=float, device=where)

    tally = wp.zeros((BLOCKS, len(SHARES)), dtype=wp.float64, device=where)
    profile = wp.zeros((BLOCKS, bins), dtype=wp.float64, device=where)
    each = max(1, paths // BLOCKS)
    wp.launch(
        _MODULES["ledger"].ledger_kernel,
        dim=BLOCKS,
        inputs=[
            problem_of(setup, False),
            stacked(stacks, setup.panels, where),
            dyes_of(properties, stacks[0], 1, (nothing, nothing), where),
            array(properties.absorption_per_mm),
            array(properties.fluorophore_per_mm * (1.0 - properties.energy_yield)),
            array(total / np.where(sigma > 0.0, sigma, 1.0)),
            array(cumulated / np.where(total > 0.0, total, 1.0)[:, None]),
            array(cosines),
            array(np.cumsum(shares) / np.sum(shares)),
            tally,
            profile,
            wp.uint64(seed),
            STREAM + 16 * wave_in,
            each,
            wave_in,
        ],
        device=where,
    )
    blocks = tally.numpy() / each
    mean, error = mean_and_error(blocks)
    whole, whole_se = mean_and_error(blocks.sum(axis=1))
    fluence, fluence_se = mean_and_error(profile.numpy() / each * bins / sample.thickness_mm)
    return Ledger(
        dict(zip(SHARES, mean.tolist(), strict=True)),
        dict(zip(SHARES, error.tolist(), strict=True)),
        float(whole),
        float(whole_se),
        fluence,
        fluence_se,
    )
