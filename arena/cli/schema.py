"""`arena schema`: prints the JSON schema of arena.yaml, with which editors complete and check keys."""

from __future__ import annotations

import json

import typer


def register(app: typer.Typer) -> None:
    """Add the command `arena schema` to the typer app."""

    @app.command()
    def schema() -> None:
        """Print the JSON schema of arena.yaml, with which editors complete and check keys."""
        from arena.schema.models import json_schema

        print(json.dumps(json_schema(), indent=2))
