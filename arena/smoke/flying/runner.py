"""Parallel flights of several scenarios. Each scenario is flown by a worker: a process with its own arena.

Each worker has its own session, so Ctrl-C in the terminal reaches only this process, the runner. At the first Ctrl-C
the runner asks every worker to land and end its arena, at the second to end the arena at once. If a worker or the
runner is killed, the arenas end as well.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import FrameType

from arena.errors import ArenaError
from arena.smoke.flying.fly_scenario import FlightOptions, fly
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.verdict import Result, Verdict

_POLL_S = 0.2
_PR_SET_PDEATHSIG = 1
_STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_libc = ctypes.CDLL(None)
OnResult = Callable[[Result], None]
Fly = Callable[[Scenario, FlightOptions], Result]


@dataclass(kw_only=True)
class _Worker:
    index: int
    process: BaseProcess
    answer: Connection


class Interrupted(KeyboardInterrupt):
    """Exception that is raised when Ctrl-C interrupts the flights. results: results of the scenarios that were complete."""

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
    waiting, workers = list(range(len(scenarios))), list[_Worker]()
    with _stops() as stops:
        asked = 0
        while workers or (waiting and not stops):
            while waiting and len(workers) < jobs and not stops:
                workers.append(_begin(waiting[0], scenarios[waiting[0]], options, flown_by))
                waiting.pop(0)
            for worker in _ended(workers):
                workers.remove(worker)
                if (result := _result(worker, scenarios[worker.index], options)) is not None:
                    results[worker.index] = result
                    on_result(result)
            if len(stops) > asked:
                asked = len(stops)
                for worker in workers:
                    worker.process.terminate()
    in_order = [results[i] for i in sorted(results)]
    if stops:
        raise Interrupted(in_order)
    return in_order


@contextmanager
def _stops() -> Iterator[list[int]]:
    """Collect SIGINT, SIGTERM and SIGHUP in a list during a `with` block, so that these signals do not interrupt the block."""
    found: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        found.append(number)

    before = {number: signal.signal(number, note) for number in _STOPS}
    try:
        yield found
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _begin(index: int, scenario: Scenario, options: FlightOptions, flown_by: Fly) -> _Worker:
    """Fork a worker that flies one scenario. Fork saves time, because a forked worker need not import the modules again."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, os.getpid(), scenario, options, flown_by))
    process.start()
    theirs.close()
    return _Worker(index=index, process=process, answer=ours)


def _work(answer: Connection, runner: int, scenario: Scenario, options: FlightOptions, flown_by: Fly) -> None:
    os.setsid()
    for number in _STOPS:
        signal.signal(number, _interrupt)
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != runner:  # the runner died before prctl
        return
    try:
        answer.send(flown_by(scenario, options))
    except KeyboardInterrupt:
        return
    except ArenaError as error:
        answer.send(_failed(scenario, options, str(error)))


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _ended(workers: Sequence[_Worker]) -> list[_Worker]:
    """Wait up to _POLL_S and return the workers that have sent a result or closed their pipe."""
    ready = wait([worker.answer for worker in workers], _POLL_S) if workers else []
    return [worker for worker in workers if worker.answer in ready]


def _result(worker: _Worker, scenario: Scenario, options: FlightOptions) -> Result | None:
    """Return the result of a worker that has ended; None if the worker was interrupted."""
    try:
        result: Result | None = worker.answer.recv()
    except EOFError:
        result = None
    worker.answer.close()
    worker.process.join()
    if result is None and worker.process.exitcode:
        return _failed(
            scenario,
            options,
            f"the process that flew the scenario ended without a result (exit code {worker.process.exitcode})",
        )
    return result


def _failed(scenario: Scenario, options: FlightOptions, problem: str) -> Result:
    seed = scenario.arena.world.seed if options.seed is None else options.seed
    verdict = Verdict(steps=(), rules=(), problems=(problem,))
    return Result(scenario=scenario.name, file=scenario.place.file, seed=seed, verdict=verdict)
