"""Several scenarios at a time, each in a process of its own that leads an arena of its own.

The workers are sessions of their own: a Ctrl-C in the terminal reaches this process alone. The first asks every worker to land
its arena and end it, the second to end it at once. A worker that is killed takes its arena along, and so does a killed runner.
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
from arena.smoke.flying.fly_scenario import How, fly
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.verdict import Result, Verdict

_TURN_S = 0.2
_PR_SET_PDEATHSIG = 1
_STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_libc = ctypes.CDLL(None)
Tell = Callable[[Result], None]
Fly = Callable[[Scenario, How], Result]


@dataclass(kw_only=True)
class _Worker:
    index: int
    process: BaseProcess
    answer: Connection


class Interrupted(KeyboardInterrupt):
    """results: of the scenarios that had ended before."""

    def __init__(self, results: Sequence[Result]) -> None:
        super().__init__()
        self.results = list(results)


def fly_all(
    scenarios: Sequence[Scenario], how: How, *, jobs: int, tell: Tell, flown_by: Fly = fly
) -> list[Result]:
    """Results in the order of the scenarios. tell: called with each as it ends. Raises Interrupted when all arenas have gone."""
    results: dict[int, Result] = {}
    waiting, workers = list(range(len(scenarios))), list[_Worker]()
    with _stops() as stops:
        asked = 0
        while workers or (waiting and not stops):
            while waiting and len(workers) < jobs and not stops:
                workers.append(_begin(waiting[0], scenarios[waiting[0]], how, flown_by))
                waiting.pop(0)
            for worker in _ended(workers):
                workers.remove(worker)
                if (result := _result(worker, scenarios[worker.index], how)) is not None:
                    results[worker.index] = result
                    tell(result)
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
    """The signals that arrive meanwhile; the loop looks at them when it can."""
    found: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        found.append(number)

    before = {number: signal.signal(number, note) for number in _STOPS}
    try:
        yield found
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _begin(index: int, scenario: Scenario, how: How, flown_by: Fly) -> _Worker:
    """A fork, for what has been imported and loaded need not be again."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, os.getpid(), scenario, how, flown_by))
    process.start()
    theirs.close()
    return _Worker(index=index, process=process, answer=ours)


def _work(answer: Connection, runner: int, scenario: Scenario, how: How, flown_by: Fly) -> None:
    os.setsid()
    for number in _STOPS:
        signal.signal(number, _interrupt)
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != runner:  # it died before we asked
        return
    try:
        answer.send(flown_by(scenario, how))
    except KeyboardInterrupt:
        return
    except ArenaError as error:
        answer.send(_failed(scenario, how, str(error)))


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _ended(workers: Sequence[_Worker]) -> list[_Worker]:
    """Those that have answered, or closed their end without a word; none after a turn."""
    ready = wait([worker.answer for worker in workers], _TURN_S) if workers else []
    return [worker for worker in workers if worker.answer in ready]


def _result(worker: _Worker, scenario: Scenario, how: How) -> Result | None:
    """What it has answered; None of one that was interrupted."""
    try:
        result: Result | None = worker.answer.recv()
    except EOFError:
        result = None
    worker.answer.close()
    worker.process.join()
    if result is None and worker.process.exitcode:
        return _failed(
            scenario, how, f"the process that flew it ended without a word ({worker.process.exitcode})"
        )
    return result


def _failed(scenario: Scenario, how: How, trouble: str) -> Result:
    seed = scenario.arena.world.seed if how.seed is None else how.seed
    verdict = Verdict(steps=(), rules=(), troubles=(trouble,))
    return Result(scenario=scenario.name, file=scenario.place.file, seed=seed, verdict=verdict)
