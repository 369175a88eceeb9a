"""The `arena` command: one module per verb, no logic.

A verb's module defines `register(app)`. Only the module of the verb that was asked for is imported. `land-all` and `kill-all` do
not even wait for typer: their command lines are read by the room that obeys them, and only their help is typer's.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, ArenaError

if TYPE_CHECKING:
    import typer

VERBS = (
    "init",
    "doctor",
    "check",
    "plan",
    "schema",
    "params",
    "smoke",
    "up",
    "ps",
    "logs",
    "restart",
    "down",
    "land-all",
    "kill-all",
)
PANIC = ("land-all", "kill-all")
_HELP = ("-h", "--help")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit code. No traceback reaches a terminal unless `--debug` is given."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = _take_debug(arguments)
    try:
        if arguments[:1] and arguments[0] in PANIC and not set(_HELP) & set(arguments):
            return _panic(arguments)
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
    import typer

    app = typer.Typer(
        name="arena",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": list(_HELP)},
    )
    app.callback(help="One YAML file becomes a flying arena.")(_nothing)
    verb = next((a for a in arguments if not a.startswith("-")), "")
    for name in (verb,) if verb in VERBS else VERBS:
        _register(app, name)
    return app


def _register(app: typer.Typer, verb: str) -> None:
    importlib.import_module(f"arena.cli.{verb.replace('-', '_')}").register(app)


def _panic(arguments: list[str]) -> int:
    with contextlib.suppress(OSError):  # where the system allows it, before everything else that runs
        os.setpriority(os.PRIO_PROCESS, 0, -15)
    from arena.emergency.land_all import command

    try:
        return command(arguments[0], arguments[1:])
    except SystemExit as done:
        return _code(done)


def _run(app: typer.Typer, arguments: list[str]) -> int:
    try:
        app(args=arguments, prog_name="arena")
    except SystemExit as done:
        return _code(done)
    return EXIT_OK


def _code(done: SystemExit) -> int:
    return done.code if isinstance(done.code, int) else EXIT_OK if done.code is None else EXIT_FAILED


def _take_debug(arguments: list[str]) -> bool:
    """Remove `--debug` wherever it stands before a `--`."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    found = "--debug" in arguments[:end]
    if found:
        arguments.remove("--debug")
    return found


def _nothing() -> None:
    """The callback that keeps typer from collapsing a single verb into the command itself."""
