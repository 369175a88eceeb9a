"""`arena doctor`: checks whether this computer has everything that arenas need."""

from __future__ import annotations

import typer

from arena.errors import EXIT_INPUT


def register(app: typer.Typer) -> None:
    """Add the command `arena doctor` to the typer app."""

    @app.command()
    def doctor() -> None:
        """Check whether this computer has everything that arenas need.

        Exit code 0: arenas can fly. Exit code 2: something is missing.
        """
        from arena.cli._health import examine

        findings = list(examine())
        for finding in findings:
            print(finding)
        if any(finding.fatal for finding in findings):
            print("this computer cannot run an arena yet: install what is marked `missing` above")
            raise SystemExit(EXIT_INPUT)
        print("this computer can run arenas with the built-in autopilot")
