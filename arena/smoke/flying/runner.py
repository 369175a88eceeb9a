"""Flies several scenarios in parallel. Each worker process flies one scenario in its own arena."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from arena.errors import ArenaError
from arena.smoke.flying.fly_scenario import FlightOptions, fly
from arena.smoke.flying.workers import Lost, run_all
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.verdict import Result, Verdict
from arena.supervisor.fork_client import ForkClient

OnResult = Callable[[Result], None]
Fly = Callable[[Scenario, FlightOptions], Result]


class Interrupted(KeyboardInterrupt):
    """Exception that is raised when Ctrl-C interrupts the flights.

    results: results of the scenarios that were complete.
    """

    def __init__(self, results: Sequence[Result]) -> None:
        super().__init__()
        self.results = list(results)


def fly_all(
    scenarios: Sequence[Scenario],
    options: FlightOptions,
    *,
    jobs: int,
    on_result: OnResult,
    flown_by: Fly = fly,
    forks: ForkClient | None = None,
) -> list[Result]:
    """Fly scenarios in parallel, the longest first, and return the results in the order of `scenarios`.

    jobs: largest number of scenarios flown at the same time.
    on_result: function that is called with each result when the flight ends.
    flown_by: function that flies one scenario; replaced by tests.
    forks: fork server for the workers and their arenas; None: none. It is used only with the default `flown_by`.
    Raises Interrupted after Ctrl-C, when all arenas have ended.
    """
    results: dict[int, Result] = {}

    def note(task: tuple[int, Scenario], result: Result | Lost) -> None:
        if isinstance(result, Lost):
            why = f"the process that flew the scenario ended without a result (exit code {result.exit_code})"
            result = _failed(task[1], options, why)
        results[task[0]] = result
        on_result(result)

    try:
        work = partial(_fly, options, flown_by)
        tasks = sorted(enumerate(scenarios), key=lambda task: -_effort(task[1]))
        run_all(tasks, work, jobs=jobs, on_end=note, forks=forks if flown_by is fly else None)
    except KeyboardInterrupt:
        raise Interrupted([results[i] for i in sorted(results)]) from None
    return [results[i] for i in sorted(results)]


def _effort(scenario: Scenario) -> float:
    """Return the estimated relative duration of a flight. Flights with a long duration start first."""
    return (1 + len(scenario.arena.vehicles)) * scenario.time_limit_s


def _fly(options: FlightOptions, flown_by: Fly, task: tuple[int, Scenario]) -> Result:
    """Fly one scenario in a worker process. If it raises ArenaError, return a failed result with the error."""
    try:
        return flown_by(task[1], options)
    except ArenaError as error:
        return _failed(task[1], options, str(error))


def _failed(scenario: Scenario, options: FlightOptions, problem: str) -> Result:
    seed = scenario.arena.world.seed if options.seed is None else options.seed
    verdict = Verdict(steps=(), rules=(), problems=(problem,))
    return Result(
        scenario=scenario.name, file=scenario.place.file, seed=seed, verdict=verdict, about=scenario.about
    )
