"""Serves the page on the loopback address, to the browsers of this machine and to nobody else."""

from __future__ import annotations

import errno
import logging
import socket
from typing import TYPE_CHECKING, Any

from twin.errors import InputError

if TYPE_CHECKING:
    from dash import Dash
    from werkzeug.serving import BaseWSGIServer

HOST = "127.0.0.1"
FIRST_PORT, TRIED = 8050, 20
"""Without --port: the first free one of these."""
POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self'"
    " 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self';"
    " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What a browser may load, and from where: from here alone."""


def free_port(asked: int | None) -> tuple[int, bool]:
    """A port that nobody listens on, and whether it is another than the usual one.

    Args:
        asked: this one or none; None looks from `FIRST_PORT` on.

    Raises:
        InputError: the port is in use or not allowed, or none is free.
    """
    if asked is not None:
        if not 1 <= asked <= 65535:
            raise InputError(f"port {asked}", "1 to 65535", place="--port")
        why = _taken(asked)
        if why:
            raise InputError(
                f"port {asked}, {why}", "a free port", place="--port",
                remedy="Choose another, or leave --port out: then the next free one is taken.",
            )  # fmt: skip
        return asked, False
    for port in range(FIRST_PORT, FIRST_PORT + TRIED):
        if not _taken(port):
            return port, port != FIRST_PORT
    raise InputError(
        f"ports {FIRST_PORT} to {FIRST_PORT + TRIED - 1} all in use", "a free one",
        place="--port", remedy="Name one with --port.",
    )  # fmt: skip


def _taken(port: int) -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except PermissionError:
            return "which only an administrator may open"
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                return "which another program listens on"
            return f"which cannot be opened ({error.strerror})"
    return ""


def serve(app: Dash, port: int) -> BaseWSGIServer:
    """A server of the page on the loopback address; `serve_forever` runs it.

    A request that names another host, or that another page made, is refused: a foreign page
    whose name was made to point here (DNS rebinding) sees nothing.
    """
    from flask import Response, request
    from werkzeug.serving import make_server

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    hosts = {f"{HOST}:{port}", f"localhost:{port}"}
    origins = {f"http://{host}" for host in hosts}

    @app.server.before_request  # type: ignore[untyped-decorator]
    def guard() -> Any:
        origin = request.headers.get("Origin")
        if request.host not in hosts or (origin is not None and origin not in origins):
            return Response(
                f"benchtwin explore answers to {HOST}:{port} alone.\n", 403, mimetype="text/plain"
            )
        return None

    @app.server.after_request  # type: ignore[untyped-decorator]
    def sealed(response: Response) -> Response:
        response.headers["Content-Security-Policy"] = POLICY
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        return response

    return make_server(HOST, port, app.server, threaded=True)
