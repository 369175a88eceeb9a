"""`arena schema`: the JSON schema of arena.yaml, for editors."""

from __future__ import annotations

import json

import typer


def register(app: typer.Typer) -> None:
    """Add the verb to the app."""

    @app.command()
    def schema() -> None:
        """Print the JSON schema of arena.yaml, for editors."""
        from arena.schema.models import json_schema

        print(json.dumps(json_schema(), indent=2))
