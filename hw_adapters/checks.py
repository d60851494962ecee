"""What the shots of a visit say about its devices: drift, leaks, hot pixels, missed exposures.

Nothing is changed or left out because of these checks: each finding is one sentence that names
the device and the remedy, and goes with the measurement.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from hw_adapters.journal import Taken
from hw_adapters.plan import PlannedShot, PlanSettings
from twin.spectra import FloatArray

_LIT = 0.1  # pixels above this share of the brightest one judge the drift of a lamp
_HOT_SIGMAS = 20.0
_HOT_SHARE = 0.01  # of full scale: a pixel above this and above the noise is hot
_LEAK_SIGMAS = 6.0
_LEAK_SHARE = 5e-4  # of full scale


def visit_notes(
    device: str,
    wavelength_nm: FloatArray,
    plan: tuple[PlannedShot, ...],
    taken: Mapping[int, Taken],
    settings: PlanSettings,
    exposed: tuple[Mapping[str, Any], ...] = (),
) -> tuple[str, ...]:
    """Sentences about what a person should know of a complete visit.

    Args:
        device: what messages call the sensor.
        wavelength_nm: wavelengths [nm] of the pixels, shape (P,).
        plan: the shots in their order.
        taken: the shots in the journal, by number.
        settings: the limit of the drift, and the wanted exposure.
        exposed: what the journal says of the exposures.
    """
    shots = [(planned, taken[planned.number]) for planned in plan]
    return (
        *_exposures(device, settings, exposed),
        *_drift(shots, settings.drift_limit),
        *_hot_pixels(device, wavelength_nm, shots),
        *_leaks(device, shots),
        *_masked(device, shots),
    )


_Shots = list[tuple[PlannedShot, Taken]]


def _exposures(
    device: str, settings: PlanSettings, exposed: Iterable[Mapping[str, Any]]
) -> Iterator[str]:
    for event in exposed:
        if event["limited"] == "no" or event["capture"] == "collimated":
            continue
        yield (
            f"{event['capture']} reaches {event['fraction']:.2f} of full scale at the"
            f" {event['limited']} setting of the {device}, not {settings.fill:g}: use a brighter"
            " or dimmer lamp"
        )


def _mean(shots: Iterable[Taken]) -> FloatArray:
    return np.asarray(np.mean([each.frame.counts for each in shots], axis=0))


def _drift(shots: _Shots, limit: float) -> Iterator[str]:
    """Of each lamp, from the first to the last reference of each sample."""
    for capture, lamp in (("white_reference", "panels"), ("beam_reference", "beam")):
        for sample in dict.fromkeys(planned.sample for planned, _ in shots):
            own = [each for p, each in shots if (p.capture, p.sample) == (capture, sample)]
            if not own:
                continue
            darks = [
                each
                for p, each in shots
                if p.capture == "dark" and p.settings.key == own[0].frame.applied.key
            ]
            half = len(own) // 2
            if half == 0 or not darks or len({p.frame.applied.key for p in own}) > 1:
                continue
            dark = _mean(darks)
            first, last = _mean(own[:half]) - dark, _mean(own[half:]) - dark
            lit = first > _LIT * first.max()
            if not lit.any() or first.max() <= 0:
                continue
            change = float(np.median(last[lit] / first[lit])) - 1.0
            if abs(change) > limit:
                word = "fell" if change < 0 else "rose"
                yield (
                    f"the {lamp} {word} by {abs(change):.1%} between the first and the last"
                    f" {capture} of {sample!r}: let the lamps warm up longer, or check their supply"
                )


def _darks(shots: _Shots) -> dict[tuple[float, float], list[Taken]]:
    found: dict[tuple[float, float], list[Taken]] = {}
    for planned, each in shots:
        if planned.capture == "dark":
            found.setdefault(planned.settings.key, []).append(each)
    return found


def _spread(values: FloatArray) -> float:
    """Standard deviation [counts] from the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _hot_pixels(device: str, wavelength_nm: FloatArray, shots: _Shots) -> Iterator[str]:
    hot = np.zeros(wavelength_nm.shape, dtype=np.bool_)
    for darks in _darks(shots).values():
        for each in darks:
            counts = each.frame.counts
            least = max(_HOT_SIGMAS * _spread(counts), _HOT_SHARE * each.frame.full_scale)
            hot |= counts > np.median(counts) + least
    if hot.any():
        where = ", ".join(f"{value:.1f}" for value in wavelength_nm[hot][:8])
        more = f" and {int(hot.sum()) - 8} more" if hot.sum() > 8 else ""
        yield (
            f"{int(hot.sum())} hot pixel(s) of the {device} in the dark, at {where}{more} nm:"
            " leave these wavelengths out, or cool the sensor"
        )


def _leaks(device: str, shots: _Shots) -> Iterator[str]:
    """Darks at one setting that rise or fall during the visit."""
    for (time_s, _), darks in _darks(shots).items():
        medians = np.array([float(np.median(each.frame.counts)) for each in darks])
        noise = _spread(darks[0].frame.counts) / np.sqrt(darks[0].frame.counts.size)
        least = max(_LEAK_SIGMAS * noise, _LEAK_SHARE * darks[0].frame.full_scale)
        change = float(medians[-1] - medians[0])
        if abs(change) > least:
            word = "rose" if change > 0 else "fell"
            yield (
                f"the darks of the {device} at {time_s:g} s {word} by {abs(change):.1f} counts"
                " during the visit: keep room light out, and let the sensor reach its temperature"
            )


def _masked(device: str, shots: _Shots) -> Iterator[str]:
    marked = sum(int(each.frame.saturated.sum()) for _, each in shots)
    if marked:
        yield f"{marked} saturated reading(s) of the {device} are masked: see `saturated`"
