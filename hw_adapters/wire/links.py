"""Cables for stand-ins that speak in lines: a serial URL, and a TCP socket of this computer.

    with serial_port(device) as url:       # "benchtwin://1", for pyserial and for pyvisa-py
    with loopback(device) as resource:     # "TCPIP0::127.0.0.1::40123::SOCKET", for pyvisa-py

Both end with their context; the socket listens on 127.0.0.1 only, at a port that the system
chooses, and its thread is joined.
"""

from __future__ import annotations

import itertools
import select
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Protocol

from hw_adapters.drivers.library import load

LONGEST_LINE = 4096


class LineDevice(Protocol):
    """A device that takes lines of text and answers with lines of text."""

    @property
    def immediate(self) -> Mapping[int, Callable[[], str]]:
        """Bytes that are answered at once, without a line end."""

    def start(self) -> str | None:
        """A connection was opened; what the device says then."""

    def line(self, text: str) -> str | None:
        """Take one line; the answer, or None. Raises OSError when the device is unplugged."""


class Conversation:
    """Bytes in, bytes out: cuts what arrives into lines for a device."""

    def __init__(self, device: LineDevice) -> None:
        self._device = device
        self._waiting = bytearray()

    def start(self) -> bytes:
        """What the device says when it is connected to."""
        return _encoded(self._device.start())

    def take(self, data: bytes) -> bytes:
        """The answers to what has arrived.

        Raises:
            OSError: the device is unplugged, or a line does not end.
        """
        answers = bytearray()
        for value in data:
            if value in self._device.immediate:
                answers += _encoded(self._device.immediate[value]())
            elif value == ord("\n"):
                text = self._waiting.decode("ascii", "replace").rstrip("\r")
                self._waiting.clear()
                answers += _encoded(self._device.line(text))
            else:
                self._waiting.append(value)
        if len(self._waiting) > LONGEST_LINE:
            raise OSError(f"a line of more than {LONGEST_LINE} characters")
        return bytes(answers)


_ports: dict[str, LineDevice] = {}
_numbers = itertools.count(1)


def port_device(url: str) -> LineDevice | None:
    """The device behind a serial URL, or None."""
    return _ports.get(url.lower())


@contextmanager
def serial_port(device: LineDevice) -> Iterator[str]:
    """Connect a device to a serial port with a URL that `serial.serial_for_url` opens.

    pyvisa-py opens it as `ASRL<url>::INSTR`.
    """
    serial = load("serial", "serial port of a stand-in")
    package = __package__ or ""
    if package not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(package)
    url = f"benchtwin://{next(_numbers)}"
    _ports[url] = device
    try:
        yield url
    finally:
        del _ports[url]


@contextmanager
def loopback(device: LineDevice) -> Iterator[str]:
    """Serve a device on a socket of this computer and give its VISA resource name.

    Raises:
        BaseException: when the context ends, what went wrong inside the device meanwhile.
    """
    with socket.create_server(("127.0.0.1", 0)) as listener:
        wake, waked = socket.socketpair()
        failures: list[Exception] = []
        thread = threading.Thread(
            target=_serve, args=(device, listener, waked, failures), daemon=True
        )
        thread.start()
        try:
            yield f"TCPIP0::127.0.0.1::{listener.getsockname()[1]}::SOCKET"
        finally:
            wake.send(b"x")
            thread.join()
            wake.close()
            waked.close()
    if failures:
        raise failures[0]


def _serve(
    device: LineDevice,
    listener: socket.socket,
    waked: socket.socket,
    failures: list[Exception],
) -> None:
    clients: dict[socket.socket, Conversation] = {}
    try:
        while True:
            # What has been sent before the end is still obeyed.
            ready, _, _ = select.select([listener, waked, *clients], [], [])
            if ready == [waked]:
                return
            if listener in ready:
                client, _ = listener.accept()
                clients[client] = Conversation(device)
                client.sendall(clients[client].start())
            for client in [one for one in ready if one in clients]:
                if not _exchange(client, clients[client], failures):
                    del clients[client]
                    client.close()
    finally:
        for client in clients:
            client.close()


def _exchange(client: socket.socket, talk: Conversation, failures: list[Exception]) -> bool:
    try:
        data = client.recv(LONGEST_LINE)
        if data:
            client.sendall(talk.take(data))
        return bool(data)
    except OSError:
        return False  # the cable is out, on one side or the other
    except Exception as failure:  # noqa: BLE001 - raised in the thread that owns the context
        failures.append(failure)
        return False


def _encoded(answer: str | None) -> bytes:
    return b"" if answer is None else answer.encode("ascii") + b"\n"
