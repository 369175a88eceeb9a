"""The command `arena`: one module per subcommand, with its options and its output.

The module of a subcommand defines `register(app)`. Only the module of the requested subcommand is imported. `arena --help`
imports none of these modules: its list is made from the table `VERBS`. Importing typer takes time. Therefore `arena.emergency`
parses the command line of `land-all` and `kill-all`, and `_checking` plain command lines of `check`. Typer shows their help.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, ArenaError

if TYPE_CHECKING:
    import typer

    from arena.supervisor.fork_client import ForkClient

# Subcommand -> its line in `arena --help`. A line repeats the docstring of the subcommand, so that `--help` imports no module.
VERBS = {
    "init": "Create a folder with an example: arena.yaml, a ten-line program, a scenario, a README and a .gitignore.",
    "doctor": "Check whether this computer has everything that arenas need.",
    "check": "Print every problem of an arena at once, or `ok` and what would run. Starts nothing.",
    "plan": "Print every process of an arena with its ports, its command and the processes that it needs.",
    "schema": "Print the JSON schema of arena.yaml, with which editors complete and check keys.",
    "params": "Generate, push, pull, compare and check the PX4 parameters of vehicles.",
    "signing": "Make and set up keys for MAVLink message signing.",
    "smoke": "Fly scenarios without a window, several at a time, and report which scenarios passed.",
    "campaign": "Fly many simulated flights over seeds and settings: `arena campaign SWEEP`. Show their results.",
    "up": "Start an arena and supervise it until its end. Ctrl-C lands the vehicles, then stops the arena.",
    "fly": "Fly a vehicle of a running arena by hand, with keys or a gamepad, or along a trajectory file: `arena fly uav1 path.csv`.",
    "shell": "Open a Python shell (IPython if installed) with `uav`, a vehicle of a running arena.",
    "replay": "Send the recorded messages of a flight again. No vehicle flies or receives commands.",
    "runs": "List the run folders of an arena, oldest first, and every running arena.",
    "summary": "Print the full result of a run: the verdict and the report (summary.txt).",
    "render": "Make a film (mp4, gif) or a picture (png) of a recorded flight. Needs no screen.",
    "report": "Write report.html with interactive figures of a run, or a page that compares two flights.",
    "audit": "Print who sent which requests to the vehicles of a run, such as arming, and which requests were refused.",
    "ps": "Show the vehicles and processes of a running arena.",
    "top": "Show the vehicles, processes and events of a running arena live in the terminal. The key q quits.",
    "monitor": "Show a running arena live on a web page, with buttons to hold, land and stop vehicles.",
    "logs": "Print the last lines of the log (stdout and stderr) of one process of a run.",
    "log": "List, describe, export, plot and compare the logs of flights, and fetch logs from vehicles.",
    "restart": "Restart one process of a running arena.",
    "forget": "Declare a real vehicle dead: the run does not wait until the vehicle is disarmed.",
    "down": "Land the vehicles, then stop the arena. The exit code is the exit code of the run.",
    "release": "Allow programs to arm and fly a vehicle again.",
    "preflight": "Check that motion capture tracks the right rigid body for a real vehicle.",
    "arm-permit": "Allow a real vehicle to arm after it was connected, rebooted or reconnected in a running arena.",
    "land-all": "Land all vehicles, and wait until each vehicle is on the ground and disarmed.",
    "kill-all": "Stop every motor at once, also in the air. To land, use land-all.",
}
GROUPS = ("params", "signing", "campaign", "log")
EMERGENCY = ("land-all", "kill-all")
_HELP = ("-h", "--help")
_FORKING = {"up": "processes", "smoke": "flights", "campaign": "flights"}
"""Subcommand -> what the fork server imports for it."""
_WITHOUT_FORKS = {*_HELP, "--detach", "--list", "--cluster", "show"}
_HELP_COLUMNS = 110
_SHORT = {"check", "plan", "schema"}
"""Subcommands that end soon, so the garbage collector never runs: it takes 7 % of the CPU time of `arena check`, and finds little."""
_GARBAGE_THRESHOLD = 50_000
"""New objects between two runs of the garbage collector. Imports make no garbage: Python's default of 700 makes them slower."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line, such as `arena up lab.yaml`, and return its exit code.

    Errors are printed without a traceback, except with `--debug`.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = _take_debug(arguments)
    gc.set_threshold(0 if arguments[:1] and arguments[0] in _SHORT else _GARBAGE_THRESHOLD)
    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # numpy starts a thread per core at its import; no verb uses them
    try:
        if arguments[:1] and arguments[0] in EMERGENCY and not set(_HELP) & set(arguments):
            return _emergency(arguments)
        if arguments[:1] == ["check"] and _checked(arguments[1:]):
            return EXIT_OK
        with _fork_server(arguments) as forks:
            return _run(build(arguments), arguments, forks)
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
            f"arena: {type(error).__name__}: {error}. This is a bug in arena. Run the command with --debug to see the traceback.",
            file=sys.stderr,
        )
        return EXIT_FAILED


def build(arguments: Sequence[str]) -> typer.Typer:
    """Return the typer app with the subcommand named in `arguments`.

    If `arguments` names no subcommand, the app can only list the subcommands: `arena --help` and a mistyped name.
    """
    verb = next((a for a in arguments if not a.startswith("-")), "")
    app = _empty_app()
    if verb in VERBS:
        _register(app, verb)
        return app
    for name in sorted(VERBS, key=GROUPS.__contains__):  # as typer: groups of commands after the commands
        app.command(name, help=VERBS[name], short_help=VERBS[name])(_listed_only)
    return app


def build_complete() -> typer.Typer:
    """Return the typer app with all subcommands.

    This imports the modules of all subcommands.
    """
    app = _empty_app()
    for name in VERBS:
        _register(app, name)
    return app


def _empty_app() -> typer.Typer:
    import typer

    app = typer.Typer(
        name="arena",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # rich and its Markdown parser take longer to import than everything else
        context_settings={"help_option_names": list(_HELP), "max_content_width": _HELP_COLUMNS},
    )

    # Without a callback, typer would omit the name of the verb if only one verb is registered.
    @app.callback(help="Fly several drones in a motion-capture arena, simulated or real, from one YAML file.")
    def arena(
        version: bool = typer.Option(
            False, "--version", is_eager=True, callback=_print_version, help="Print the version and exit."
        ),
    ) -> None:
        pass

    return app


def _listed_only() -> None:
    raise AssertionError(
        "bug in arena: this subcommand was called, but only its help was loaded, not its module"
    )


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


def _checked(arguments: list[str]) -> bool:
    """Run `arena check` without typer, and return True if its arguments are plain. Raises InputError for a wrong arena."""
    from arena.cli._checking import check, plain_options

    options = plain_options(arguments)
    if options is not None:
        check(options)
    return options is not None


@contextlib.contextmanager
def _fork_server(arguments: Sequence[str]) -> Iterator[ForkClient | None]:
    """Run a fork server during a `with` block, so that an arena starts quickly. Yield the server's client.

    The fork server imports packages while this process reads the YAML. For commands that start no arena, yield None.

    A detached run has no fork server, because its supervisor is another process.
    """
    packages = _FORKING.get(next(iter(arguments), ""))
    if packages is None or _WITHOUT_FORKS & set(arguments):
        yield None
        return
    from arena.supervisor.fork_client import ForkClient

    forks = None
    with contextlib.suppress(
        OSError
    ):  # no further process or file: without it, interpreters start the arena, or report the error
        forks = ForkClient(packages)
    try:
        yield forks
    finally:
        if forks is not None:
            forks.close()


def _run(app: typer.Typer, arguments: list[str], forks: ForkClient | None) -> int:
    """Run a subcommand and return its exit code.

    forks: client of the fork server, for `arena up`.
    """
    try:
        app(args=arguments, prog_name="arena", obj=forks)
    except SystemExit as done:
        return _code(done)
    return EXIT_OK


def _code(done: SystemExit) -> int:
    return done.code if isinstance(done.code, int) else EXIT_OK if done.code is None else EXIT_FAILED


def _take_debug(arguments: list[str]) -> bool:
    """Remove `--debug` from the arguments, and return True if the option was there.

    A `--debug` after `--` is not an option and stays.
    """
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
