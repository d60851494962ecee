"""Exposure found by trying: cut on saturation, then scale; gain first on a chip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hw_adapters.errors import Saturated
from hw_adapters.protocols import Applied, Frame, Limits
from twin.errors import InputError

ATTEMPTS = 16
"""Most readings until an exposure is taken as it is."""

SATURATED_SHARE = 0.01
"""Share of saturated pixels from which on a reading counts as saturated; fewer are masked."""

_CLOSE = 0.02  # an exposure this close to the wanted share of full scale is good
_CUT = 4.0
_MOST_GROWTH = 20.0
_FAINTEST = 0.002  # share of full scale below which a signal says nothing about the factor

Limited = Literal["no", "shortest", "longest"]


@dataclass(frozen=True, slots=True)
class Attempt:
    """One reading on the way to an exposure."""

    applied: Applied
    fraction: float
    """Brightest pixel over full scale."""
    saturated: bool


@dataclass(frozen=True, slots=True)
class Exposed:
    """An exposure that was found."""

    applied: Applied
    fraction: float
    """Brightest pixel over full scale."""
    limited: Limited
    """"no", or that the shortest (lowest) or longest (highest) setting was reached before."""


Read = Callable[[Applied], Frame]
"""Sets the sensor, throws frames away, and takes one reading of a single frame."""


def is_saturated(frame: Frame) -> bool:
    """Whether so many pixels are saturated that it is the light and not a pixel's fault."""
    return float(np.mean(frame.saturated)) > SATURATED_SHARE


def expose(
    read: Read,
    dark: Frame,
    limits: Limits,
    start: Applied,
    *,
    device: str,
    what: str,
    fill: float = 0.8,
    longest_s: float = np.inf,
    log: Callable[[Attempt], None] = lambda attempt: None,
) -> Exposed:
    """Find the settings at which the brightest pixel reads a share of full scale.

    A sensor with gains changes its gain, and its time only where the lowest gain saturates; one
    without changes its integration time.

    Args:
        read: takes a reading.
        dark: a reading without light at the settings `start`.
        limits: of the sensor.
        start: settings to begin with.
        device: what messages call the sensor.
        what: what messages call the light, such as "white_reference".
        fill: wanted share of full scale.
        longest_s: longest integration time [s] that is worth it.
        log: told of every attempt.

    Raises:
        Saturated: the light saturates at the shortest time (and lowest gain).
        DeviceError: the sensor fails.
    """
    level = float(np.median(dark.counts))
    # A pixel that is bright in the dark must not set the exposure of the others.
    cold = dark.counts <= level + 0.05 * dark.full_scale
    if not cold.any():
        raise InputError(
            f"a dark of {level:g} counts of {dark.full_scale}", "a dark without light",
            place=device, remedy="Switch every lamp and the room light off.",
        )  # fmt: skip

    def trial(applied: Applied) -> tuple[float, bool]:
        frame = read(applied)
        saturated = is_saturated(frame)
        fraction = float(frame.counts[cold].max()) / frame.full_scale
        log(Attempt(frame.applied, fraction, saturated))
        return fraction, saturated

    search = _by_gain if limits.gains else _by_time
    return search(trial, limits, start, level / dark.full_scale, fill, longest_s, device, what)


_Trial = Callable[[Applied], tuple[float, bool]]


def _by_time(
    trial: _Trial,
    limits: Limits,
    start: Applied,
    level: float,
    fill: float,
    longest_s: float,
    device: str,
    what: str,
) -> Exposed:
    shortest = limits.rounded(limits.shortest_s)
    longest = max(limits.rounded(min(longest_s, limits.longest_s)), shortest)
    now = min(max(start.integration_s, shortest), longest)
    too_long = np.inf
    fraction = 0.0
    for _ in range(ATTEMPTS):
        fraction, saturated = trial(replace(start, integration_s=now, averages=1))
        if saturated:
            if now <= shortest * (1 + 1e-9):
                raise _saturates(device, what, f"the shortest integration time, {now:g} s")
            too_long = min(too_long, now)
            now = limits.rounded(max(now / _CUT, shortest))
            continue
        if abs(fraction - fill) <= _CLOSE:
            return Exposed(_timed(start, now), fraction, "no")
        signal = fraction - level
        factor = _MOST_GROWTH
        if signal > _FAINTEST:
            factor = min((fill - level) / signal, _MOST_GROWTH)
        wanted = now * factor
        if wanted >= too_long:
            wanted = (now + too_long) / 2
        following = limits.rounded(min(max(wanted, shortest), longest))
        if abs(following / now - 1) < 1e-3:
            limited: Limited = "no"
            if wanted > longest * (1 + 1e-9):
                limited = "longest"
            elif wanted < shortest * (1 - 1e-9):
                limited = "shortest"
            return Exposed(_timed(start, now), fraction, limited)
        now = following
    return Exposed(_timed(start, now), fraction, "no")


def _by_gain(
    trial: _Trial,
    limits: Limits,
    start: Applied,
    level: float,
    fill: float,
    longest_s: float,
    device: str,
    what: str,
) -> Exposed:
    gains = limits.gains
    index = gains.index(start.gain) if start.gain in gains else len(gains) // 2
    highest = len(gains) - 1
    now = replace(start, averages=1)
    for _ in range(ATTEMPTS):
        now = replace(now, gain=gains[index])
        fraction, saturated = trial(now)
        if saturated and index > 0:
            highest = index - 1
            index = max(0, index - 2)
            continue
        if saturated:
            now = _shorter(now, limits, device, what)
            continue
        signal = max(fraction - level, 1e-9)
        fitting = [
            number
            for number, gain in enumerate(gains[: highest + 1])
            if level + signal * gain / now.gain <= fill or (number == index and fraction <= fill)
        ]
        chosen = fitting[-1] if fitting else 0
        if chosen == index:
            limited: Limited = "no"
            if chosen == len(gains) - 1:
                limited = "longest"
            elif chosen == 0 and fraction > fill:
                limited = "shortest"
            return Exposed(replace(now, averages=start.averages), fraction, limited)
        if chosen < index:
            highest = index - 1
        index = chosen
    return Exposed(replace(now, averages=start.averages), fraction, "no")


def _shorter(now: Applied, limits: Limits, device: str, what: str) -> Applied:
    """Half the integration steps of a chip, by its register ASTEP."""
    # Below 65 535 steps full scale falls as the counts do: a shorter time does not help.
    steps = round(now.integration_s / limits.step_s)
    if now.atime is None or now.astep is None or now.astep < 1 or steps <= 65_535:
        raise _saturates(device, what, f"gain {now.gain:g} and {now.integration_s:g} s")
    astep = (now.astep + 1) // 2 - 1
    time_s = (now.atime + 1) * (astep + 1) * limits.step_s
    return replace(now, astep=astep, integration_s=time_s)


def _timed(start: Applied, time_s: float) -> Applied:
    return replace(start, integration_s=time_s)


def _saturates(device: str, what: str, setting: str) -> Saturated:
    return Saturated(
        device, f"{what} that saturates at {setting}", "light below full scale",
        "Dim the lamp, close the aperture, or use a less sensitive instrument; then go on with"
        " --resume.",
    )  # fmt: skip
