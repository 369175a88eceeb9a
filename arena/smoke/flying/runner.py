"""Flies several scenarios in parallel. Each worker process flies one scenario in its own arena."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from arena.errors import ArenaError
from arena.smoke.flying.fly_scenario import FlightOptions, fly
from arena.smoke.flying.workers import Lost, run_all
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.verdict import Result, Verdict

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
) -> list[Result]:
    """Fly scenarios and return their results in the same order.

    jobs: largest number of scenarios flown at the same time.
    on_result: function that is called with each result when the flight ends.
    flown_by: function that flies one scenario; replaced by tests.
    Raises Interrupted after Ctrl-C, when all arenas have ended.
    """
    results: dict[int, Result] = {}

    def work(task: tuple[int, Scenario]) -> Result:
        try:
            return flown_by(task[1], options)
        except ArenaError as error:
            return _failed(task[1], options, str(error))

    def note(task: tuple[int, Scenario], result: Result | Lost) -> None:
        if isinstance(result, Lost):
            why = f"the process that flew the scenario ended without a result (exit code {result.exit_code})"
            result = _failed(task[1], options, why)
        results[task[0]] = result
        on_result(result)

    try:
        run_all(list(enumerate(scenarios)), work, jobs=jobs, on_end=note)
    except KeyboardInterrupt:
        raise Interrupted([results[i] for i in sorted(results)]) from None
    return [results[i] for i in sorted(results)]


def _failed(scenario: Scenario, options: FlightOptions, problem: str) -> Result:
    seed = scenario.arena.world.seed if options.seed is None else options.seed
    verdict = Verdict(steps=(), rules=(), problems=(problem,))
    return Result(
        scenario=scenario.name, file=scenario.place.file, seed=seed, verdict=verdict, about=scenario.about
    )
