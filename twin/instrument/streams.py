"""Independent streams of random numbers, one per (key, contribution)."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from twin.errors import InputError


class Stream(IntEnum):
    """What a stream is for; the number is the highest word of Philox's counter.

    Streams of one key never overlap, so that switching one contribution off leaves the random
    numbers of the others as they were.
    """

    SHOT_NOISE = 1
    READ_NOISE = 2
    PATTERN = 3
    LAMP = 4


def generator(stream: Stream, first: int, second: int = 0) -> np.random.Generator:
    """The generator of a stream, keyed by two numbers, 0 to 2**64 - 1 each.

    Source: Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3" (Philox 4x64-10).

    Raises:
        InputError: a key outside its range.
    """
    for key in (first, second):
        if not 0 <= key < 2**64:
            raise InputError(f"{key}", "a seed or shot number from 0 to 2**64 - 1", place="seed")
    counter = np.array([0, 0, 0, int(stream)], dtype=np.uint64)
    keys = np.array([first, second], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(counter=counter, key=keys))
