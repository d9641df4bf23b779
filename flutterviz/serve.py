"""Owns the serving of the explorer: the checks before it starts, what the terminal is told, and its end."""

from __future__ import annotations

import contextlib
import signal
import socket
import threading
import time
import webbrowser
from pathlib import Path
from types import FrameType

import rich
from rich.console import Console

from solver import Design

ERR = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)


def serve(design: Design, host: str, port: int, record: Path | None, browse: bool) -> int:
    """Serve the explorer until Ctrl-C or SIGTERM; gives the exit code.

    Raises:
        OSError: the address cannot be served on, or the recording cannot be written.
        DesignError: the design cannot be simulated.
    """
    begun = time.perf_counter()
    _refuse_address(host, port)
    if host not in ("127.0.0.1", "localhost", "::1"):
        ERR.print(f"serving on {host}: anyone who reaches this machine can open and steer the page, without a password")
    if record is not None:
        from flutterviz.recording import refuse_unwritable

        refuse_unwritable(record)
    ERR.print("building the panel and letting it flutter; the first start also compiles the solver, for some seconds …")
    import viser  # late: it is slow to import, and a wrong port should be told at once

    from flutterviz.app import Explorer
    from flutterviz.session import Session

    session = Session(design)
    rich.get_console().quiet = True  # on which viser says what we say better, and on stdout
    server = viser.ViserServer(host=host, port=port, verbose=False)
    with contextlib.ExitStack() as ending:
        ending.callback(server.stop)
        explorer = Explorer(session, server, record)
        url = f"http://{'localhost' if host == '0.0.0.0' else host}:{server.get_port()}"
        ERR.print(f"flutterviz is serving on {url} after {time.perf_counter() - begun:.1f} s (Ctrl-C ends it)")
        if browse:
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()

        def leave(number: int, frame: FrameType | None) -> None:
            explorer.running = False

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, leave)
        try:
            explorer.run()
        finally:
            explorer.close()
    return 0


def _refuse_address(host: str, port: int) -> None:
    """Refuse an address that viser could not bind: it would take another port, or hang."""
    if not 0 <= port <= 65535:
        raise OSError(f"port {port} does not exist: choose one from 1024 to 65535 with --port, or 0 for any")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        reason = error.strerror or str(error)
        remedy = "choose another with --port, or --port 0 for any free one"
        raise OSError(f"cannot serve on {host}, port {port}: {reason}; {remedy}") from None
