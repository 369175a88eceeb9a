"""`arena doctor`: what this machine has for flying arenas, what it lacks, and how to get it."""

from __future__ import annotations

import typer

from arena.errors import EXIT_INPUT


def register(app: typer.Typer) -> None:
    @app.command()
    def doctor() -> None:
        """Tell what is found and what is missing for flying arenas. Starts nothing; 0 when arenas can fly, else 2."""
        from arena.cli._health import examine

        findings = list(examine())
        for finding in findings:
            print(finding)
        if any(finding.fatal for finding in findings):
            print("arenas cannot fly here yet: see what is missing above")
            raise SystemExit(EXIT_INPUT)
        print("arenas with the built-in autopilot can fly here")
