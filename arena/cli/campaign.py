"""`arena campaign`: fly many simulated flights with different seeds and settings, and show their results.

Exit codes: 0 all flights passed; 1 a flight failed or was lost; 2 the sweep, or an arena of it, is not valid, or a file of the
campaign was changed while it flew; 130 after Ctrl-C, when all arenas have ended. The results so far are kept.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from arena.cli._options import Jobs, jobs_or_cores
from arena.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from arena.campaign.campaign import FlyAll
    from arena.campaign.progress import ProgressBar, ProgressLines
    from arena.supervisor.fork_client import ForkClient

_LOG_COLUMNS = 160  # width without a terminal, so that the lines in a log file are not wrapped


class _FlyByDefault(TyperGroup):
    """Command group in which the word `fly` is optional: `arena campaign SWEEP` means `arena campaign fly SWEEP`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert the word `fly` if the first argument is not the name of a command or `--help`."""
        known = {*self.commands, *self.get_help_option_names(ctx)}
        return super().parse_args(ctx, ["fly", *args] if args and args[0] not in known else args)


def register(app: typer.Typer) -> None:
    """Add the commands of `arena campaign` to the typer app."""
    group = typer.Typer(
        cls=_FlyByDefault,
        no_args_is_help=True,
        help="Fly many simulated flights over seeds and settings: `arena campaign SWEEP`. Show their results.",
    )
    for command in (fly, show):
        group.command()(command)
    app.add_typer(group, name="campaign")


def fly(
    context: typer.Context,
    sweep: Annotated[
        Path,
        typer.Argument(
            metavar="SWEEP", help="sweep file of the campaign, with the seeds and settings that vary"
        ),
    ],
    jobs: Jobs = None,
    results: Annotated[
        Path | None,
        typer.Option(
            "--results", metavar="DIR", help="folder of the results; default: campaigns/NAME of the campaign"
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            "--cluster",
            metavar="ADDRESS",
            help="fly on the computers of this Ray cluster: HOST:PORT, or auto; default: `cluster` of the sweep file",
        ),
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="fly the flights again that have failed")
    ] = False,
    list_: Annotated[
        bool, typer.Option("--list", help="check and list the flights, without flying them")
    ] = False,
) -> None:
    """Fly a campaign, or resume a campaign: flights that have a result are not flown again.

    The word `fly` can be left out.
    """
    from arena.campaign import design, preparation
    from arena.campaign.campaign import fly_campaign
    from arena.campaign.report import describe
    from arena.campaign.store import Store, listing_of
    from arena.campaign.sweep import load_sweep
    from arena.campaign.table import WITHOUT_PYARROW, has_pyarrow
    from arena.kernels import INTERPRETED

    if cluster is not None and jobs is not None:
        raise InputError(
            "got both --cluster and --jobs, expected one of them: a cluster always flies one flight per CPU core"
        )
    found = load_sweep(sweep)
    flights = design.flights(found)
    inputs = preparation.check(found, flights).inputs
    if list_:
        for flight in flights:
            print(f"{flight.id}  {describe(flight.number, flight.seed, flight.settings)}")
        return
    if not has_pyarrow():
        print(WITHOUT_PYARROW, file=sys.stderr)
    if INTERPRETED:
        print(INTERPRETED, file=sys.stderr)
    listing = listing_of(found, inputs, flights)
    store = Store((results or Path("campaigns") / found.name).resolve())
    # With --jobs, the computers of the sweep file's cluster are not used.
    fly_all = _fly_all(jobs, cluster or (found.cluster if jobs is None else None), sweep, inputs, context.obj)
    on_cluster = cluster is not None or (found.cluster is not None and jobs is None)
    with _progress(1 if on_cluster else jobs_or_cores(jobs)) as progress:
        finished = fly_campaign(store, listing, flights, fly_all, progress, retry_failed=retry_failed)
    _print(store.folder)
    raise SystemExit(finished.exit_code)


def show(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="folder of the results of a campaign")],
) -> None:
    """Print the results of a campaign, and write its table and its plots.

    The campaign may still be flying: then the results are those of all flights so far.
    """
    from arena.campaign.report import in_campaign
    from arena.campaign.store import Store
    from arena.campaign.table import WITHOUT_PYARROW, has_pyarrow, write_all

    store = Store(folder)
    listing = store.listing()
    if listing is None:
        raise InputError(
            f"{folder}: not the folder of a campaign, because it has no campaign.json. Expected a folder such as campaigns/NAME"
        )
    write_all(listing, in_campaign(listing, store.records().values()), folder)
    if not has_pyarrow():
        print(WITHOUT_PYARROW, file=sys.stderr)
    _print(folder)


def _fly_all(
    jobs: int | None,
    cluster: str | None,
    sweep: Path,
    inputs: Mapping[str, str],
    forks: ForkClient | None,
) -> FlyAll:
    """Return the function that flies the flights of a campaign: on a Ray cluster, or on this computer."""
    if cluster is None:
        from arena.campaign import runner

        return partial(runner.fly_all, jobs=jobs_or_cores(jobs), forks=forks)
    from arena.campaign import ray_cluster
    from arena.campaign.ray_task import inputs_of

    return partial(ray_cluster.fly_all, address=cluster, inputs=inputs_of(inputs, sweep.parent))


def _progress(jobs: int) -> ProgressBar | ProgressLines:
    from rich.console import Console

    from arena.campaign.progress import Pace, ProgressBar, ProgressLines

    console = Console()
    return ProgressBar(Pace(jobs), console) if console.is_terminal else ProgressLines(Pace(jobs), _say)


def _say(text: str) -> None:
    print(text, flush=True)


def _print(folder: Path) -> None:
    from rich.console import Console

    from arena.campaign.report import in_campaign, text
    from arena.campaign.store import Store

    store = Store(folder)
    if (listing := store.listing()) is None:
        return
    console = Console(width=None if sys.stdout.isatty() else _LOG_COLUMNS)
    console.print(text(listing, in_campaign(listing, store.records().values())))
    print(f"results: {folder}", flush=True)
