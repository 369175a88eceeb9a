"""`arena replay`: send a recorded flight again to viewers, the recorder and user programs."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arena.cli._options import AsJson, NoReport, Quiet, TimeLimit, Verbose, speed_of
from arena.errors import InputError
from arena.run_dirs import starting_alone
from arena.supervisor import Options, active_runs, create, plan_of

if TYPE_CHECKING:
    from arena.plan import Plan
    from arena.plan.replay import ReplaySettings

Paths = Annotated[
    list[Path],
    typer.Argument(
        metavar="PATH...",
        help="run folder, flight.mcap, or one or more logs of vehicles: CSV files or PX4's ULogs",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command `arena replay` to the typer app."""

    @app.command()
    def replay(  # noqa: PLR0913, PLR0917 - an option each
        paths: Paths,
        speed: Annotated[
            str,
            typer.Option(
                "--speed",
                metavar="X",
                help="speed: recorded seconds per second of wall time, or max for the highest speed",
            ),
        ] = "1",
        from_s: Annotated[
            float,
            typer.Option(
                "--from", metavar="T", min=0.0, help="begin T seconds after the start of the record"
            ),
        ] = 0.0,
        loop: Annotated[
            bool, typer.Option("--loop", help="begin again when the end of the record is reached")
        ] = False,
        pause: Annotated[
            bool,
            typer.Option("--pause", help="begin paused; continue with the time bar of `arena monitor`"),
        ] = False,
        stay: Annotated[
            bool,
            typer.Option(
                "--stay",
                help="keep the replay running at the end of the record, so that a viewer can go back",
            ),
        ] = False,
        gcs: Annotated[
            list[str] | None,
            typer.Option(
                "--gcs",
                metavar="ADDRESS",
                help="also send the telemetry to a ground station at this address on another computer",
            ),
        ] = None,
        no_gcs: Annotated[
            bool, typer.Option("--no-gcs", help="send nothing to a ground station on this computer")
        ] = False,
        address: Annotated[
            str | None,
            typer.Option(
                "--address",
                metavar="A",
                help="loopback address of the replay; default: the first free address from 127.0.77.1 on",
            ),
        ] = None,
        detach: Annotated[
            bool,
            typer.Option(
                "--detach", help="return as soon as the replay runs; the replay continues in the background"
            ),
        ] = False,
        headless: Annotated[
            bool, typer.Option("--headless", help="do not show the live table in the terminal")
        ] = False,
        time_limit: TimeLimit = None,
        no_report: NoReport = False,
        runs: Annotated[
            Path | None,
            typer.Option(
                "--runs",
                metavar="DIR",
                help="folder in which the run folder is created; default: next to the replayed run, or ./runs for logs",
            ),
        ] = None,
        quiet: Quiet = False,
        verbose: Verbose = False,
        as_json: AsJson = False,
    ) -> None:
        """Send the recorded messages of a flight again. No vehicle flies or receives commands."""
        from arena.cli.up import output_of, run_detached, run_plan
        from arena.plan.make import without_report

        show = output_of(quiet=quiet, verbose=verbose, as_json=as_json, headless=headless)
        found = settings_of(paths)
        with starting_alone(partial(print, file=sys.stderr)):
            changed = dataclasses.replace(
                found,
                speed=speed_of(speed),
                from_s=from_s,
                loop=loop,
                paused=pause,
                stay=stay,
                stations=tuple(gcs or ()),
                local_station=not no_gcs and not _real_vehicles_run(),
            )
            plan = _plan(changed, address)
            if no_report:
                plan = without_report(plan)
            beside = Path(changed.folder).parent if changed.folder else Path("runs")
            folder = create(plan, runs if runs is not None else beside)
        options = Options(until_done=not stay, time_limit_s=time_limit, adopt=True)
        if detach:
            raise SystemExit(run_detached(plan, folder, options))
        raise SystemExit(run_plan(plan, folder, show, options))


def settings_of(paths: Sequence[Path]) -> ReplaySettings:
    """Read the logs to replay, and return the settings of the replay with default options.

    Raises InputError if a file cannot be read.
    """
    from arena.plan.replay import ReplayedVehicle, ReplaySettings, recorded_yaml
    from arena.replay.describe import describe

    found = describe(paths)
    yaml = recorded_yaml(found.folder / "arena.yaml") if found.folder is not None else {}
    return ReplaySettings(
        name=found.name,
        sources=found.sources,
        vehicles=[ReplayedVehicle(**dataclasses.asdict(v)) for v in found.vehicles],
        size_m=found.size_m,
        unix_clock=found.unix_clock,
        recorded=yaml,
        drawn=found.drawn,
        folder=str(found.folder) if found.folder is not None else "",
    )


def _plan(settings: ReplaySettings, address: str | None) -> Plan:
    """Return the plan (list of all processes) of a replay whose processes use this IPv4 address.

    address: None means the first free loopback address. Raises InputError if the address is in use.
    """
    from arena.plan.machine import Machine, choose_address
    from arena.plan.replay import ADDRESS, make_replay_plan

    plan = make_replay_plan(settings, address or ADDRESS)
    taken = {state.address: f"run {state.run}" for state in active_runs() if state.live}
    choice = choose_address(plan, taken, Machine())
    if choice.address == plan.address:
        return plan
    if address is not None:
        address_problem = choice.why.partition(":")[0]
        raise InputError(f"{address_problem}. Omit --address, or try {choice.address}")
    return make_replay_plan(settings, choice.address)


def _real_vehicles_run() -> bool:
    """Return whether an arena with real vehicles is running on this computer.

    A ground station would then mix up real and replayed vehicles with the same id, so a replay sends it nothing. An arena counts also
    if its supervisor has died, or if its plan cannot be read.
    """
    plans = [plan_of(state) for state in active_runs() if state.live or state.survivors()]
    found = any(plan is None or any(not v.simulated for v in plan.vehicles) for plan in plans)
    if found:
        print(
            "an arena with real vehicles is running: the replay sends nothing to ground stations on this computer",
            file=sys.stderr,
        )
    return found
