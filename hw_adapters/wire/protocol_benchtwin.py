"""pyserial's handler of URLs `benchtwin://...`: a serial port without a computer's serial port.

The name of this module is how pyserial finds it (`serial.protocol_handler_packages`).
"""

from __future__ import annotations

from serial.serialutil import PortNotOpenError, SerialBase, SerialException

from hw_adapters.wire.links import Conversation, port_device


class Serial(SerialBase):  # type: ignore[misc]
    """A serial port with a stand-in at its other end.

    An answer is there as soon as its line has been written, so a read without data is a time-out
    at once.
    """

    def open(self) -> None:
        """Connect to the device that the URL names.

        Raises:
            SerialException: no device is connected there.
        """
        device = port_device(self.port or "")
        if device is None:
            raise SerialException(f"could not open port {self.port}: no such device")
        self._talk = Conversation(device)
        self._received = bytearray(self._talk.start())
        self.is_open = True

    def close(self) -> None:
        """Disconnect."""
        self.is_open = False

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read."""
        self._opened()
        return len(self._received)

    def read(self, size: int = 1) -> bytes:
        """At most `size` bytes of what has arrived."""
        self._opened()
        data = bytes(self._received[:size])
        del self._received[:size]
        return data

    def write(self, data: bytes) -> int:
        """Send bytes to the device.

        Raises:
            SerialException: the device is unplugged.
        """
        self._opened()
        try:
            self._received += self._talk.take(bytes(data))
        except OSError as failure:
            raise SerialException(f"write failed: {failure}") from failure
        return len(data)

    def flush(self) -> None:
        """Everything has been sent."""
        self._opened()

    def reset_input_buffer(self) -> None:
        """Forget what has arrived."""
        self._opened()
        self._received.clear()

    def reset_output_buffer(self) -> None:
        """Everything has been sent."""

    def _opened(self) -> None:
        if not self.is_open:
            raise PortNotOpenError()

    def _reconfigure_port(self) -> None:
        """Baud rate, parity and the like mean nothing here."""
