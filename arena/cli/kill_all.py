"""Options and help of `arena kill-all --yes`, which stops all motors, even in the air.

The package `arena.emergency` has the code.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from arena.emergency.land_all import KILL_TIMEOUT_S, kill_all, names


def register(app: typer.Typer) -> None:
    """Add the command `arena kill-all` to the typer app."""

    @app.command("kill-all")
    def kill_all_(
        arena: Annotated[
            Optional[Path],  # noqa: UP045
            typer.Argument(help="Path of arena.yaml; needed only if no run is active."),
        ] = None,
        run: Annotated[Optional[Path], typer.Option(help="The run folder.")] = None,  # noqa: UP045
        only: Annotated[str, typer.Option(help="Vehicles to stop, such as uav1,uav2; all by default.")] = "",
        spared: Annotated[
            str, typer.Option("--except", help="Vehicles whose motors must keep running, such as uav1,uav2.")
        ] = "",
        yes: Annotated[
            bool, typer.Option("--yes", help="Required. Confirms that flying vehicles will fall.")
        ] = False,
        timeout: Annotated[float, typer.Option(help="Give up after this many seconds.")] = KILL_TIMEOUT_S,
    ) -> None:
        """Stop every motor at once, also in the air. To land, use land-all."""
        code = kill_all(
            arena=arena, run=run, only=names(only), spared=names(spared), yes=yes, timeout_s=timeout
        )
        raise typer.Exit(code)
