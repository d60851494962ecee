"""What the command says when something is missing, and how it ends."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.console import Console
from scenarios.explore import command
from twin.errors import InputError


def test_a_missing_library_is_said_with_the_command(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "dash", None)
    with pytest.raises(InputError, match=r'pip install "benchtwin\[explore\]"'):
        command.explored(None)
    answer = CliRunner().invoke(app, ["explore", "--no-browser", "--json"])
    assert answer.exit_code == 2
    assert "benchtwin[explore]" in answer.output


def test_a_port_in_use_is_said_before_the_work_starts(monkeypatch) -> None:
    pytest.importorskip("dash", reason="the extra explore is not installed")
    monkeypatch.setattr(command, "explored", lambda *_, **__: pytest.fail("worked in vain"))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match="another program listens"):
            command.explore(None, port=taken.getsockname()[1], browser=False)


def test_files_that_cannot_be_explored_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("dash", reason="the extra explore is not installed")
    with pytest.raises(InputError, match="a built-in scenario"):
        command.explored("no-such-thing")
    with pytest.raises(InputError):
        command.explored("default", diagnosis=tmp_path)


class Told(Console):
    """Keeps what is said; interrupts once the page is there."""

    def __init__(self) -> None:
        super().__init__(quiet=True)
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)
        if "the page is at" in text:
            threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()


def test_ctrl_c_ends_it(monkeypatch) -> None:
    dash = pytest.importorskip("dash", reason="the extra explore is not installed")
    page = dash.Dash("test", enable_mcp=False)
    page.layout = dash.html.Div()
    monkeypatch.setattr(command, "explored", lambda *_, **__: page)
    told, before = Told(), signal.getsignal(signal.SIGTERM)
    answer = command.explore(None, browser=False, console=told)
    assert told.lines[-1] == "ended"
    assert answer["address"].startswith("http://127.0.0.1:")
    assert signal.getsignal(signal.SIGTERM) is before
    port = int(answer["address"].rstrip("/").rsplit(":", 1)[1])
    with socket.socket() as again, pytest.raises(ConnectionRefusedError):
        again.connect(("127.0.0.1", port))
