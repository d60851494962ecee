"""Averages that are made on the computer: several frames of a sensor become one reading."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hw_adapters.frames import RawFrame

REREADS = 2
"""How often a frame that equals the one before is read again before it is believed."""

_FEWEST_PIXELS = 64  # with fewer, two frames may well be equal by chance


class FrameAverager:
    """The mean of frames, each of them new.

    A frame that equals the one before it in every pixel was most likely sent twice, and is read
    again. A quiet sensor in the dark may really repeat itself, so that after `REREADS` tries the
    frame is believed; `repeated` counts the frames thrown away.

    Attributes:
        repeated: frames thrown away because they came twice.
    """

    def __init__(self) -> None:
        self.repeated = 0
        self._last: RawFrame | None = None

    def forget(self) -> None:
        """The next frame may equal the last one: the settings were changed."""
        self._last = None

    def mean(self, read: Callable[[], RawFrame], averages: int) -> RawFrame:
        """Counts averaged over frames, and whether any of them was saturated; shape (P,) each.

        Args:
            read: takes one frame.
            averages: number of frames.
        """
        frame = self._new(read)
        total, saturated = frame.counts.copy(), frame.saturated.copy()
        for _ in range(averages - 1):
            frame = self._new(read)
            total += frame.counts
            saturated |= frame.saturated
        return RawFrame(total / averages, saturated)

    def _new(self, read: Callable[[], RawFrame]) -> RawFrame:
        frame = read()
        for _ in range(REREADS):
            last = self._last
            if (
                last is None
                or frame.counts.size < _FEWEST_PIXELS
                or not np.array_equal(frame.counts, last.counts)
            ):
                break
            self.repeated += 1
            frame = read()
        self._last = frame
        return frame
