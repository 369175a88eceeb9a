"""`arena smoke`: fly scenarios without a window and report which passed.

Exit codes: 0 all scenarios passed; 1 at least one failed; 2 a scenario or an arena is not valid, so nothing was flown;
130 after Ctrl-C, when all arenas have landed and ended.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arena.cli._options import Jobs, jobs_or_cores, speed_of
from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, InputError

if TYPE_CHECKING:
    from arena.smoke.flying.fly_scenario import FlightOptions
    from arena.smoke.language.scenario import Scenario
    from arena.smoke.referee.verdict import Result
    from arena.supervisor.fork_client import ForkClient

ENDING = ".smoke.yaml"
_LOG_COLUMNS = 160  # width of the table without a terminal, so that paths in a CI log are not wrapped


def register(app: typer.Typer) -> None:
    """Add the command `arena smoke` to the typer app."""

    @app.command()
    def smoke(
        context: typer.Context,
        scenarios: Annotated[
            list[Path],
            typer.Argument(
                metavar="SCENARIO...", help=f"scenario files, or folders that contain *{ENDING} files"
            ),
        ],
        junit: Annotated[
            Path | None,
            typer.Option("--junit", metavar="FILE", help="write the results as JUnit XML, for a CI server"),
        ] = None,
        jobs: Jobs = None,
        speed: Annotated[
            str,
            typer.Option(
                "--speed",
                metavar="X",
                help="speed of the simulation: simulated seconds per second of wall time, or max",
            ),
        ] = "max",
        seed: Annotated[
            int | None,
            typer.Option(
                "--seed",
                metavar="N",
                help="seed of the noise in the simulated world and in motion capture; default: the seeds in the YAML files",
            ),
        ] = None,
        set_: Annotated[
            list[str] | None,
            typer.Option("--set", metavar="KEY=VALUE", help="override one value of the arenas' YAML"),
        ] = None,
        results: Annotated[
            Path, typer.Option("--results", metavar="DIR", help="folder in which the run folders are created")
        ] = Path("results"),
        repeat: Annotated[
            int, typer.Option("--repeat", metavar="N", min=1, help="fly each scenario N times")
        ] = 1,
        list_: Annotated[
            bool, typer.Option("--list", help="check and list the scenarios, without flying them")
        ] = False,
    ) -> None:
        """Fly scenarios without a window, several at a time, and report which scenarios passed.

        All files are checked before the first flight.
        """
        from arena.kernels import INTERPRETED
        from arena.smoke.flying.fly_scenario import FlightOptions

        speed_of(speed)  # its error names --speed, and not --set
        seeds = [] if seed is None else [f"world.seed={seed}", f"mocap.seed={seed}"]
        found = load(files(scenarios), [*(set_ or []), f"sim.speed={speed}", *seeds])
        if list_:
            for one in found:
                print(f"{one.place.file}: {one.name}" + (f": {one.about}" if one.about else ""))
            return
        for folder in (results, *(() if junit is None else (junit.parent,))):
            _make(folder)
        if junit is not None and junit.is_dir():
            raise InputError(f"{junit}: is a folder, expected a file for --junit. Try {junit / 'junit.xml'}")
        if INTERPRETED:
            print(INTERPRETED, file=sys.stderr)
        options = FlightOptions(results=results.resolve(), speed=speed, seed=seed)
        raise SystemExit(_fly(found * repeat, options, _jobs(jobs, speed), junit, context.obj))


def _jobs(jobs: int | None, speed: str) -> int:
    """Return the number of flights to fly at the same time.

    This is `jobs`, or one per CPU core, and one more at the speed `max`.

    A flight needs no CPU time in a part of its start and its end. At a given speed one more flight could be too much for the cores.
    """
    return jobs or jobs_or_cores(None) + (speed == "max")


def _make(folder: Path) -> None:
    """Create a folder and its parents. Raise InputError if the folder cannot be created."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be created: {error.strerror}") from error


def files(named: list[Path]) -> list[Path]:
    """Return the paths of all scenario files in a list of files and folders.

    A folder stands for all scenario files in it and its subfolders.

    Raises InputError if a folder contains no scenario file.
    """
    found: list[Path] = []
    for path in named:
        inside = sorted(path.rglob(f"*{ENDING}")) if path.is_dir() else [path]
        if not inside:
            raise InputError(f"{path}: no *{ENDING} file in this folder or its subfolders")
        found += inside
    return list(dict.fromkeys(found))


def load(paths: list[Path], overrides: list[str]) -> list[Scenario]:
    """Load all scenario files and return their scenarios.

    Raises InputError with the problems of all files.
    """
    from arena.smoke.flying.fly_scenario import refuse_real
    from arena.smoke.language.scenario import load_scenarios

    found: list[Scenario] = []
    problems: list[str] = []
    for path in paths:
        try:
            found += (scenarios := load_scenarios(path, overrides))
            for scenario in scenarios:
                refuse_real(scenario.arena)
        except InputError as error:
            problems += [line for line in str(error).splitlines() if line not in problems]
    if problems:
        raise InputError("\n".join(problems))
    return found


def _fly(
    scenarios: list[Scenario],
    options: FlightOptions,
    jobs: int,
    junit: Path | None,
    forks: ForkClient | None,
) -> int:
    from arena.smoke.flying.runner import Interrupted, fly_all

    try:
        results = fly_all(scenarios, options, jobs=jobs, on_result=_print_result, forks=forks)
    except Interrupted as interrupted:
        flown = Counter(result.scenario for result in interrupted.results)
        missing = list((Counter(scenario.name for scenario in scenarios) - flown).elements())
        _write_results(interrupted.results, options.results, junit, missing)
        print(
            f"interrupted: {len(missing)} of {len(scenarios)} scenarios were not completed; all arenas have landed and ended"
        )
        return EXIT_INTERRUPTED
    _write_results(results, options.results, junit)
    return EXIT_OK if all(result.verdict.passed for result in results) else EXIT_FAILED


def _print_result(result: Result) -> None:
    word = "passed" if result.verdict.passed else "FAILED"
    print(
        f"{word}  {result.scenario}  ({result.verdict.lasted_s:.1f} s simulated in {result.wall_s:.1f} s)",
        flush=True,
    )


def _write_results(
    results: list[Result], folder: Path, junit: Path | None, unflown: Sequence[str] = ()
) -> None:
    from rich.console import Console

    from arena.smoke.report import junit_xml, results_json, summary, table

    (folder / "results.json").write_text(results_json(results))
    if junit is not None:
        junit.write_text(junit_xml(results, unflown))
    if results:
        Console(width=None if sys.stdout.isatty() else _LOG_COLUMNS).print(table(results))
        print(summary(results), flush=True)
