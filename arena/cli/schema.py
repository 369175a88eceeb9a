"""`arena schema`: the JSON schema of arena.yaml, for editors."""

from __future__ import annotations

import typer


def register(app: typer.Typer) -> None:
    @app.command()
    def schema() -> None:
        """Print the JSON schema of arena.yaml, for editors."""
        raise KeyboardInterrupt
