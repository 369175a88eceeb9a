"""`arena kill-all --yes`: stops the motors, flying or not."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from arena.safety.land_all import kill_all


def register(app: typer.Typer) -> None:
    @app.command("kill-all")
    def kill_all_(
        arena: Annotated[Optional[Path], typer.Argument(help="arena.yaml, where no run is active")] = None,  # noqa: UP045
        run: Annotated[Optional[Path], typer.Option(help="The run folder.")] = None,  # noqa: UP045
        yes: Annotated[bool, typer.Option("--yes", help="Needed: what flies will fall.")] = False,
        timeout: Annotated[float, typer.Option(help="When to give up, in seconds.")] = 10.0,
    ) -> None:
        """Stop every motor at once, also in the air. To land, use land-all."""
        raise typer.Exit(kill_all(arena=arena, run=run, yes=yes, timeout_s=timeout))
