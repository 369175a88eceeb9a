"""`arena doctor`: what this machine has for flying arenas, what is missing, and how to install it."""

from __future__ import annotations

import typer

from arena.errors import EXIT_INPUT


def register(app: typer.Typer) -> None:
    """Add the verb to the app."""

    @app.command()
    def doctor() -> None:
        """Print what this machine has for flying arenas and what is missing. Exit code 0: arenas can fly; 2: they cannot."""
        from arena.cli._health import examine

        findings = list(examine())
        for finding in findings:
            print(finding)
        if any(finding.fatal for finding in findings):
            print("arenas cannot fly here yet: see what is missing above")
            raise SystemExit(EXIT_INPUT)
        print("arenas with the built-in autopilot can fly here")
