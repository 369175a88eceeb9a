"""Process of the live web page: `python -m arena.monitor`, which does the same as `arena monitor`.

It only receives. If it dies or hangs, nothing in the arena changes.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib.util
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from arena.constants import MONITOR_PORT
from arena.errors import EXIT_OK, ArenaError, InputError
from arena.process_context import ProcessContext, supervisor_socket

HOST = "127.0.0.1"
"""Address of the page, unless the user chooses another one."""
NOT_INSTALLED = "the page needs the package viser. Install it: pip install 'flying-arena[monitor]'"


def serve(
    run: Path | None, host: str, port: int, *, token: bool = False, say: Callable[[str], None] = print
) -> int:
    """Serve the live page until a signal ends the process, and return the exit code.

    run: folder of the run to watch; None for the only running arena.  port: the next free port is used if it is taken.
    token: require a token on a loopback address, too.
    say: called with the URL of the page when the page answers, and with the reason if there is no arena to show.
    Raises InputError if viser is not installed or the address is wrong, RunError if no port is free.
    """
    if importlib.util.find_spec("viser") is None:
        raise InputError(NOT_INSTALLED)
    from arena.live_view import LiveFeed
    from arena.monitor.access import access_for
    from arena.monitor.page import show
    from arena.monitor.server import free_port, open_server

    access_for(host, port)  # reports a wrong address before a port is searched
    access = access_for(host, free_port(host, port), token=token)
    server, feed = open_server(access), LiveFeed(run)
    feed.poll()
    empty = feed.waiting_for
    stop = threading.Event()
    drawing = asyncio.run_coroutine_threadsafe(show(server, feed), server.get_event_loop())
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    # a URL with a token is a secret, and the supervisor writes events into files that are shared
    shown = "the log of this process contains the URL" if access.token else access.url
    process = ProcessContext("monitor", {}, supervisor_socket())
    process.event(f"watch live: {shown}")
    say(f"watch the arena: {access.url}")
    if empty and not process.supervised:
        say(f"the page is still empty: {empty}")
    stop.wait()
    drawing.cancel()
    feed.close()
    server.stop()
    return EXIT_OK


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m arena.monitor", allow_abbrev=False)
    parser.add_argument("--run", type=Path, metavar="DIR", help="the run folder")
    parser.add_argument("--host", default=HOST, metavar="ADDRESS", help="address that the page binds")
    parser.add_argument("--port", type=int, default=MONITOR_PORT, help="TCP port of the page")
    parser.add_argument("--token", action="store_true", help="require a token on a loopback address, too")
    given = parser.parse_args(argv)
    try:
        return serve(
            given.run, given.host, given.port, token=given.token, say=lambda text: print(text, flush=True)
        )
    except ArenaError as error:
        print(f"monitor: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
