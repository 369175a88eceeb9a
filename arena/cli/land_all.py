"""Options and help of `arena land-all`, which lands all vehicles in an emergency.

The package `arena.emergency` has the code.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from arena.constants import LAND_TIMEOUT_S
from arena.emergency.land_all import land_all, names


def register(app: typer.Typer) -> None:
    """Add the command `arena land-all` to the typer app."""

    @app.command("land-all")
    def land_all_(
        arena: Annotated[
            Optional[Path],  # noqa: UP045
            typer.Argument(help="Path of arena.yaml; needed only if no run is active."),
        ] = None,
        run: Annotated[Optional[Path], typer.Option(help="The run folder.")] = None,  # noqa: UP045
        only: Annotated[str, typer.Option(help="Vehicles to land, such as uav1,uav2; all by default.")] = "",
        spared: Annotated[
            str, typer.Option("--except", help="Vehicles not to land, such as uav1,uav2.")
        ] = "",
        timeout: Annotated[float, typer.Option(help="Give up after this many seconds.")] = LAND_TIMEOUT_S,
    ) -> None:
        """Land all vehicles, and wait until each vehicle is on the ground and disarmed.

        Works without supervisor and router.
        """
        code = land_all(arena=arena, run=run, only=names(only), spared=names(spared), timeout_s=timeout)
        raise typer.Exit(code)
