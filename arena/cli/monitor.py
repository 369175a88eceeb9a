"""Options of `arena monitor`, the live web page of a running arena. The package `arena.monitor` has the code."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arena.constants import MONITOR_PORT

HOST = "127.0.0.1"


def register(app: typer.Typer) -> None:
    """Add the command `arena monitor` to the typer app."""

    @app.command()
    def monitor(
        run: Annotated[
            Path | None,
            typer.Option(
                "--run",
                metavar="DIR",
                help="run folder of the arena; needed only if several arenas are running",
            ),
        ] = None,
        host: Annotated[
            str,
            typer.Option(
                "--host",
                metavar="ADDRESS",
                help="address of the page; for other computers: 0.0.0.0 or an address of their network (the page then requires a token)",
            ),
        ] = HOST,
        port: Annotated[
            int,
            typer.Option(
                "--port",
                min=1,
                max=65535,
                help="TCP port of the page; if this port is in use, the page uses the next free port",
            ),
        ] = MONITOR_PORT,
        token: Annotated[
            bool,
            typer.Option(
                "--token",
                help="require the token of the printed URL on this computer, too; needed for a browser of another user or in a container",
            ),
        ] = False,
    ) -> None:
        """Show a running arena live on a web page, with buttons to hold, land and stop vehicles.

        Waits for an arena if no arena is running.
        """
        from arena.monitor.__main__ import serve

        raise SystemExit(serve(run, host, port, token=token, say=lambda text: print(text, flush=True)))
