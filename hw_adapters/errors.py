"""What can go wrong with a device: every message names the device and says what to do.

All of them are `twin.errors.InputError`, so that the command line prints one message and no
traceback. A request that a device cannot fulfil is refused; nothing is clipped.
"""

from __future__ import annotations

from twin.errors import InputError


class DeviceError(InputError):
    """A device did not do what was asked of it.

    Attributes:
        device: model and serial number, as in `DeviceInfo.name`.
        found, expected, remedy: as in `InputError`.
    """

    expected_default = "a device that answers"
    remedy_default = "Check its cable and its power, then go on with --resume."

    def __init__(self, device: str, found: str, expected: str = "", remedy: str = "") -> None:
        self.device = device
        super().__init__(
            found,
            expected or self.expected_default,
            place=device,
            remedy=remedy or self.remedy_default,
        )


class DeviceMissing(DeviceError):
    """A device, or the library that drives it, is not there."""

    expected_default = "a device that is connected"
    remedy_default = "Connect it, or name another one; `benchtwin devices` lists what is there."


class DeviceLost(DeviceError):
    """A device that was there no longer answers: unplugged, or without power."""

    expected_default = "a device that stays connected"
    remedy_default = "Plug it in again, then go on with --resume."


class DeviceTimeout(DeviceError):
    """A device did not answer in time."""

    expected_default = "an answer in time"
    remedy_default = "Check its cable, switch it off and on, then go on with --resume."


class RequestOutOfLimits(DeviceError):
    """A setting that the device cannot take; it is refused, not clipped."""

    expected_default = "a setting within the device's limits"
    remedy_default = "Ask for a setting within the limits."


class UnknownCommand(DeviceError):
    """A command, register or channel that the device does not know."""

    expected_default = "a command that the device knows"
    remedy_default = "The driver and the device do not fit: check the model that is named."


class BadAnswer(DeviceError):
    """An answer that cannot be: a frame too short, a number that is no number."""

    expected_default = "a complete answer"
    remedy_default = "Use a shorter or better cable, then go on with --resume."


class StaleFrame(BadAnswer):
    """A frame that the device has sent before."""

    expected_default = "a new frame"
    remedy_default = "Switch the device off and on, then go on with --resume."


class WrongDevice(DeviceError):
    """Another device than the bench file or the journal names."""

    expected_default = "the device that the bench file names"
    remedy_default = "Connect that one, or write the new one's serial number into the bench file."


class Saturated(DeviceError):
    """Light beyond full scale where it was to be below."""

    expected_default = "light below full scale"
    remedy_default = "Dim the lamp or close the aperture, then go on with --resume."
