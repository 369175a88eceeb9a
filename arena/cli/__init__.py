"""The `arena` command: one module per verb, no logic.

A verb's module defines `register(app)`. Only the module of the verb that was asked for is imported, so that `arena land-all`
starts without the schema, the plan or the terminal's tables.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

import typer

from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, ArenaError

VERBS = ("init", "doctor", "check", "plan", "schema", "params", "up", "ps", "logs", "restart", "down", "land-all", "kill-all")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit code. No traceback reaches a terminal unless `--debug` is given."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = _take_debug(arguments)
    try:
        return _run(build(arguments), arguments)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # `arena plan | head`: nobody reads any more, which is no failure of ours
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    except ArenaError as error:
        if debug:
            raise
        print(f"arena: {error}" if "\n" not in str(error) else str(error), file=sys.stderr)
        return error.exit_code
    except Exception as error:
        if debug:
            raise
        print(
            f"arena: {type(error).__name__}: {error}. This is a fault of arena; --debug shows where.",
            file=sys.stderr,
        )
        return EXIT_FAILED


def build(arguments: Sequence[str]) -> typer.Typer:
    """The app with the verb that the arguments name, or with every verb when they name none (`--help`)."""
    app = typer.Typer(
        name="arena",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(help="One YAML file becomes a flying arena.")(_nothing)
    verb = next((a for a in arguments if not a.startswith("-")), "")
    for name in (verb,) if verb in VERBS else VERBS:
        _register(app, name)
    return app


def _register(app: typer.Typer, verb: str) -> None:
    importlib.import_module(f"arena.cli.{verb.replace('-', '_')}").register(app)


def _run(app: typer.Typer, arguments: list[str]) -> int:
    try:
        app(args=arguments, prog_name="arena")
    except SystemExit as done:
        return done.code if isinstance(done.code, int) else EXIT_OK if done.code is None else EXIT_FAILED
    return EXIT_OK


def _take_debug(arguments: list[str]) -> bool:
    """Remove `--debug` wherever it stands before a `--`."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    found = "--debug" in arguments[:end]
    if found:
        arguments.remove("--debug")
    return found


def _nothing() -> None:
    """The callback that keeps typer from collapsing a single verb into the command itself."""
