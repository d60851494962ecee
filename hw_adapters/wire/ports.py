"""What every stand-in on the wire is given: counts, time, and faults."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FrameSource = Callable[[float], NDArray[np.integer]]
"""Integration time [s] -> one frame [counts], whole numbers, shape (pixels,)."""

Sleep = Callable[[float], None]
"""Lets time [s] of the bench pass."""

FaultHook = Callable[[str], str]
"""Operation of a device ("usb650.frame") -> the name of the fault to act out now, or "".

`hw_adapters.faults.Faults.hook` is one."""


def no_faults(operation: str) -> str:
    """The hook of a device that works."""
    return ""
