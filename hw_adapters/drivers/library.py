"""Import of a driver library when, and only when, a device needs it."""

from __future__ import annotations

import importlib
import importlib.metadata
from types import ModuleType

from hw_adapters.errors import DeviceMissing

INSTALL = 'pip install "benchtwin[instruments]"'


def load(module: str, device: str) -> ModuleType:
    """A module of a driver library.

    Args:
        module: what is imported, such as "seabreeze.pyseabreeze".
        device: the device that needs it, for the message.

    Raises:
        DeviceMissing: the library is not installed; the message holds the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as failure:
        raise DeviceMissing(
            device, f"no library {module.partition('.')[0]!r} ({failure})", "it to be installed",
            f"Run: {INSTALL}",
        ) from failure  # fmt: skip


def driver_name(distribution: str) -> str:
    """A distribution with its version, such as "seabreeze 2.11.0"."""
    try:
        return f"{distribution} {importlib.metadata.version(distribution)}"
    except importlib.metadata.PackageNotFoundError:
        return distribution
