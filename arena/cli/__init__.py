"""The command `arena`, with one module per subcommand. Each module contains only the options and the output of its subcommand.

The module of a verb defines `register(app)`. Only the module of the requested verb is imported. For `land-all` and
`kill-all`, `arena.emergency` parses the command line, because importing typer takes time. Typer shows only their help.
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
    "signing",
    "smoke",
    "up",
    "runs",
    "summary",
    "audit",
    "ps",
    "logs",
    "restart",
    "forget",
    "down",
    "release",
    "preflight",
    "arm-permit",
    "land-all",
    "kill-all",
)
EMERGENCY = ("land-all", "kill-all")
_HELP = ("-h", "--help")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line and return the exit code. A traceback is printed only with `--debug`."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = _take_debug(arguments)
    try:
        if arguments[:1] and arguments[0] in EMERGENCY and not set(_HELP) & set(arguments):
            return _emergency(arguments)
        return _run(build(arguments), arguments)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # for example `arena plan | head`: the reader has ended, which is not a failure
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
            f"arena: {type(error).__name__}: {error}. This is a bug in arena. --debug shows the traceback.",
            file=sys.stderr,
        )
        return EXIT_FAILED


def build(arguments: Sequence[str]) -> typer.Typer:
    """Return the typer app with the subcommand named in `arguments`, or with all subcommands if none is named."""
    import typer

    app = typer.Typer(
        name="arena",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": list(_HELP)},
    )

    # Without a callback, typer would omit the name of the verb if only one verb is registered.
    @app.callback(help="Fly several drones in a motion-capture arena, simulated or real, from one YAML file.")
    def arena(
        version: bool = typer.Option(
            False, "--version", is_eager=True, callback=_print_version, help="Print the version and exit."
        ),
    ) -> None:
        pass

    verb = next((a for a in arguments if not a.startswith("-")), "")
    for name in (verb,) if verb in VERBS else VERBS:
        _register(app, name)
    return app


def _register(app: typer.Typer, verb: str) -> None:
    importlib.import_module(f"arena.cli.{verb.replace('-', '_')}").register(app)


def _emergency(arguments: list[str]) -> int:
    with contextlib.suppress(OSError):  # higher priority than other programs, if the system allows it
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
    """Remove `--debug` from the arguments, unless it comes after a `--`. Return True if `--debug` was removed."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    found = "--debug" in arguments[:end]
    if found:
        arguments.remove("--debug")
    return found


def _print_version(wanted: bool) -> None:
    if wanted:
        from arena import __version__

        print(f"arena {__version__}")
        raise SystemExit(EXIT_OK)
