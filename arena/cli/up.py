"""`arena up`: start an arena, supervise it, land the vehicles at the end, and stop it.

Exit codes: 0 success; 1 a program, a vehicle, a process or the landing failed; 2 the input is wrong; 130 after Ctrl-C.
`arena down` and SIGTERM end a run normally (0), except while `--until-done` still waits for a program.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arena.cli._arena import clock_notes, copilot_notes, not_possible, without_effect
from arena.cli._consent import ask_consent
from arena.cli._options import AsJson, NoReport, Quiet, TimeLimit, Verbose, speed_of
from arena.cli._page import with_page
from arena.cli._placing import place, refuse_beside
from arena.cli._running import user_name
from arena.errors import EXIT_FAILED, EXIT_OK, InputError
from arena.kernels import INTERPRETED
from arena.plan.model import Plan
from arena.plan.open_ports import open_lines
from arena.process_title import set_title
from arena.run_dirs import starting_alone
from arena.supervisor import (
    JsonLines,
    Level,
    Lines,
    Message,
    Options,
    RunFolder,
    Supervisor,
    create,
    sweep_all,
)
from arena.supervisor.fork_client import ForkClient

if TYPE_CHECKING:
    from arena.schema import Arena

File = Annotated[Path, typer.Argument(help="YAML file of the arena, or a folder with arena.yaml")]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override one value of the YAML")
]


def register(app: typer.Typer) -> None:
    """Add the command `arena up` to the typer app."""

    @app.command()
    def up(  # noqa: PLR0913, PLR0917 - an option each
        context: typer.Context,
        file: File = Path("arena.yaml"),
        set_: Set = None,
        detach: Annotated[
            bool,
            typer.Option(
                "--detach",
                help="return when all processes are started; the arena continues in the background",
            ),
        ] = False,
        headless: Annotated[
            bool,
            typer.Option(
                "--headless", help="show neither pybullet's window nor the live table in the terminal"
            ),
        ] = False,
        gui: Annotated[bool, typer.Option("--gui", help="open pybullet's window")] = False,
        speed: Annotated[
            str | None,
            typer.Option(
                "--speed",
                metavar="X",
                help="speed of the simulation: simulated seconds per second of wall time, or max; the same as --set sim.speed=X",
            ),
        ] = None,
        seed: Annotated[
            int | None,
            typer.Option(
                "--seed",
                metavar="N",
                min=0,
                help="seed of the noise in the simulated world and in motion capture; the same as --set world.seed=N --set mocap.seed=N",
            ),
        ] = None,
        processes: Annotated[
            bool,
            typer.Option(
                "--processes",
                help="run world, motion capture, pose forwarders, router and recorder of a simulated arena as separate processes; "
                "the same as --set sim.processes=many",
            ),
        ] = False,
        realtime: Annotated[
            bool,
            typer.Option(
                "--realtime",
                help="run the world at a higher priority than other programs (needs root); the same as --set sim.realtime=true",
            ),
        ] = False,
        foxglove: Annotated[
            bool,
            typer.Option(
                "--foxglove",
                help="show the flight live in Foxglove, at ws://ADDRESS:8765; the same as --set log.foxglove=true",
            ),
        ] = False,
        allow_diff: Annotated[
            bool,
            typer.Option(
                "--allow-diff",
                help="fly real vehicles even if their parameters differ from the values that `arena params push` would write",
            ),
        ] = False,
        monitor: Annotated[
            bool,
            typer.Option(
                "--monitor",
                help="show the flight live on a web page (`arena monitor`); the same as --set tools.monitor=true",
            ),
        ] = False,
        yes: Annotated[
            bool, typer.Option("--yes", help="do not ask for confirmation before real vehicles may arm")
        ] = False,
        until_done: Annotated[
            bool,
            typer.Option(
                "--until-done", help="end the run when every program has ended and every vehicle is disarmed"
            ),
        ] = False,
        time_limit: TimeLimit = None,
        runs: Annotated[
            Path | None,
            typer.Option(
                "--runs",
                metavar="DIR",
                help="folder for the run folders; default: `runs` next to the YAML file",
            ),
        ] = None,
        no_report: NoReport = False,
        quiet: Quiet = False,
        verbose: Verbose = False,
        as_json: AsJson = False,
    ) -> None:
        """Start an arena and supervise it until its end. Ctrl-C lands the vehicles, then stops the arena."""
        show = output_of(quiet=quiet, verbose=verbose, as_json=as_json, headless=headless)
        overrides = list(set_ or []) + (["sim.gui=true"] if gui else ["sim.gui=false"] if headless else [])
        overrides += ["preflight.params=false"] if allow_diff else []
        overrides += ["sim.realtime=true"] if realtime else []
        overrides += ["sim.processes=many"] if processes else []
        overrides += ["log.foxglove=true"] if foxglove else []
        overrides += ["tools.monitor=true"] if monitor else []
        overrides += [f"world.seed={seed}", f"mocap.seed={seed}"] if seed is not None else []
        if speed is not None:
            speed_of(speed)  # its error names --speed, and not --set
            overrides.append(f"sim.speed={speed}")
        notes = sys.stderr if as_json or quiet else sys.stdout
        say = partial(print, file=notes, flush=True)
        arena, plan = _load(file, overrides, say)
        with contextlib.ExitStack() as lock:
            lock.enter_context(starting_alone(say))
            # in the foreground, the page reports its URL as an event, when it answers
            plan, page = with_page(place(arena, plan, overrides, say), url=detach or quiet or as_json)
            real = not all(v.simulated for v in plan.vehicles)
            if real:
                lock.close()  # other arenas need not wait while a person answers
            for line in (*open_lines(plan), *([page] if page else [])):
                say(line)
            with contextlib.redirect_stdout(notes):
                consent = ask_consent(plan, yes=yes)
            plan = _without_report(plan) if no_report else plan
            if real:
                lock.enter_context(starting_alone(say))
                refuse_beside(plan)
            beside = file if file.is_dir() else file.parent
            folder = create(plan, runs if runs is not None else beside / "runs")
        permit_by = f"{user_name()} (arena up, {consent})" if consent else ""
        options = Options(until_done=until_done, time_limit_s=time_limit, adopt=True, permit_by=permit_by)
        if detach:
            raise SystemExit(run_detached(plan, folder, options, as_json=as_json))
        raise SystemExit(run_plan(plan, folder, show, options, context.obj))


def output_of(*, quiet: bool, verbose: bool, as_json: bool, headless: bool) -> Lines:
    """Return the object that prints the progress of a run: live table, lines or JSON.

    The live table needs a terminal. Raises InputError for -q together with -v.

    headless: no live table.
    """
    if quiet and verbose:
        raise InputError("got both -q and -v, expected one of them")
    level = Level.RESULT if quiet else Level.DETAIL if verbose else Level.CHANGE
    live = sys.stdout.isatty() and not (headless or quiet or as_json)
    if live:
        from arena.supervisor import LiveTable

        return LiveTable(level)
    return JsonLines(level) if as_json else Lines(level)


def _without_report(plan: Plan) -> Plan:
    from arena.plan.make import without_report

    return without_report(plan)


def _load(file: Path, overrides: list[str], say: Callable[[str], None]) -> tuple[Arena, Plan]:
    """Load and check the YAML. Return the arena and the plan of the run.

    Also ends the processes of crashed earlier runs. A crashed run is a run on the same address whose
    supervisor has died. Raises InputError for problems of the YAML.

    say: prints which processes it ends.
    """
    from arena.plan import make_plan
    from arena.schema import load_arena

    arena = load_arena(file, overrides)
    for line in (*not_possible(arena), *without_effect(arena), *clock_notes(arena), *copilot_notes(arena)):
        print(line, file=sys.stderr)
    if arena.simulated and INTERPRETED:
        print(INTERPRETED, file=sys.stderr)
    plan = make_plan(arena)
    sweep_all(say, plan.address)
    return arena, plan


def run_plan(
    plan: Plan, folder: RunFolder, show: Lines, options: Options, forks: ForkClient | None = None
) -> int:
    """Run a plan in this process, print the result and return the exit code. Call it in the main thread.

    forks: client of the fork server, which starts the processes of a simulated arena; None: none. It is closed.
    """
    if forks is not None and not all(v.simulated for v in plan.vehicles):
        forks.close()
        forks = None
    set_title(f"arena:up {plan.name}")
    show.say(Message(text=f"{plan.name}: starting {len(plan.processes)} processes, run folder {folder.path}"))
    try:
        code = Supervisor(plan, folder, show, options, forks).run()
    finally:
        show.close()
    _print_result(folder.path, code, show)
    show.flush()
    return code


def _print_result(run: Path, code: int, show: Lines) -> None:
    """Print the result of a run: the verdict (passed or failed), and a short table.

    With -q, print the verdict only; with -v, print the full summary, too.
    """
    from arena.cli._summary import lines_of, read_json, verdict

    if isinstance(show, JsonLines):
        failed = read_json(run / "outcome.json").get("failed")
        result = {"verdict": verdict(run), "exit_code": code, "failed": failed, "run": str(run)}
        show.print(json.dumps(result))
        return
    lines = lines_of(run, columns=shutil.get_terminal_size((160, 24)).columns)
    for line in lines[:1] if show.level is Level.RESULT else lines:
        show.print(line)
    summary = run / "summary.txt"
    if show.level is Level.DETAIL and summary.is_file():
        show.print(summary.read_text().rstrip())
    if show.level is not Level.RESULT:
        show.print(f"run folder: {run}")
        if (page := run / "report.html").is_file():
            show.print(f"report: {page}")
        if summary.is_file() and show.level is Level.CHANGE:
            show.print(f"more: arena summary {run}")


class _Piped(Lines):
    """Output of `arena up --detach`: writes to the supervisor's log, and reports start or end through a pipe.

    The parent process, `arena up --detach`, reads the pipe.
    """

    def __init__(self, pipe: int) -> None:
        super().__init__(Level.DETAIL)
        self._pipe = pipe

    def report(self, **packet: Any) -> None:
        """Send the parent process one JSON object that describes the start or the end of the run. Close the pipe.

        Later calls do nothing.
        """
        if self._pipe >= 0:
            with contextlib.suppress(OSError):
                os.write(self._pipe, json.dumps(packet).encode() + b"\n")
                os.close(self._pipe)
            self._pipe = -1

    def started(self, failed: list[str]) -> None:
        """Report to the parent process, `arena up --detach`, that the start is complete.

        failed: one text per process that failed to start.
        """
        self.report(started=True, failed=failed)


def run_detached(plan: Plan, folder: RunFolder, options: Options, *, as_json: bool = False) -> int:
    """Fork the supervisor into its own session, and wait until all processes are started or the run has ended.

    Return the exit code of `arena up --detach`.

    as_json: print where the arena runs as a JSON object.
    """
    reading, writing = os.pipe2(os.O_CLOEXEC)
    log = folder.log("supervisor")
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        _become_daemon(log)
        os._exit(_run_detached(plan, folder, options, _Piped(writing)))
    os.close(writing)
    with os.fdopen(reading) as pipe:
        packet = json.loads(pipe.readline() or "{}")
    if packet.get("started"):
        run = str(folder.path)
        print(
            json.dumps({"arena": plan.name, "supervisor": pid, "run": run})
            if as_json
            else f"{plan.name} is running, supervisor {pid}\nrun folder: {run}\nstop it with: arena down --run {run}"
        )
        for text in packet["failed"]:
            print(f"arena: {text}", file=sys.stderr)
        return EXIT_FAILED if packet["failed"] else EXIT_OK
    os.waitpid(pid, 0)
    print(log.read_text(errors="replace").rstrip(), file=sys.stderr)
    return int(packet.get("ended", EXIT_FAILED))


def _run_detached(plan: Plan, folder: RunFolder, options: Options, show: _Piped) -> int:
    code = EXIT_FAILED
    try:
        code = run_plan(plan, folder, show, options)
    except BaseException:
        import traceback

        traceback.print_exc()  # into the supervisor's log: no caller can catch it
    show.report(ended=code)
    sys.stdout.flush()
    return code


def _become_daemon(log: Path) -> None:
    os.setsid()
    nowhere, file = (
        os.open(os.devnull, os.O_RDONLY),
        os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644),
    )
    for fd, target in ((nowhere, 0), (file, 1), (file, 2)):
        os.dup2(fd, target)
