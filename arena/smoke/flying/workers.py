"""Worker processes that carry out tasks in parallel, such as the flights of `arena smoke` and `arena campaign`.

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
from typing import Any, Generic, TypeVar

POLL_S = 0.2
_PR_SET_PDEATHSIG = 1
_STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_libc = ctypes.CDLL(None)

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, kw_only=True)
class Lost:
    """End of a worker process that has sent no result, for example because it was killed.

    exit_code: negative for a signal.
    """

    exit_code: int


@dataclass(kw_only=True)
class _Worker(Generic[T]):
    task: T
    process: BaseProcess
    answer: Connection


def run_all(
    tasks: Sequence[T],
    work: Callable[[T], R],
    *,
    jobs: int,
    on_end: Callable[[T, R | Lost], None],
    on_poll: Callable[[], None] = lambda: None,
) -> None:
    """Carry out tasks in worker processes. Return when all tasks have ended.

    work: function that carries out one task. At an interruption, it raises KeyboardInterrupt.
    jobs: largest number of tasks at the same time.
    on_end: function that is called with each task that ended, and its result.
    on_poll: function that is called every POLL_S or more often.
    Raises KeyboardInterrupt after Ctrl-C, when all workers have ended.
    """
    waiting, workers = list(tasks), list[_Worker[T]]()
    with collected_stops() as stops:
        asked = 0
        while workers or (waiting and not stops):
            while waiting and len(workers) < jobs and not stops:
                workers.append(_begin(waiting.pop(0), work))
            for worker in _ended(workers):
                workers.remove(worker)
                if (result := _result(worker)) is not None:
                    on_end(worker.task, result)
            on_poll()
            if len(stops) > asked:
                asked = len(stops)
                for worker in workers:
                    worker.process.terminate()
    if stops:
        raise KeyboardInterrupt


@contextmanager
def collected_stops() -> Iterator[list[int]]:
    """Collect SIGINT, SIGTERM and SIGHUP in a list during a `with` block.

    These signals do not interrupt the block.
    """
    found: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        found.append(number)

    before = {number: signal.signal(number, note) for number in _STOPS}
    try:
        yield found
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _begin(task: T, work: Callable[[T], R]) -> _Worker[T]:
    """Fork a worker process for one task.

    A forked worker need not import the modules again.
    """
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, os.getpid(), task, work))
    process.start()
    theirs.close()
    return _Worker(task=task, process=process, answer=ours)


def _work(answer: Connection, runner: int, task: T, work: Callable[[T], R]) -> None:
    os.setsid()
    for number in _STOPS:
        signal.signal(number, _interrupt)
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != runner:  # the runner died before prctl
        return
    try:
        answer.send(work(task))
    except KeyboardInterrupt:
        return


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _ended(workers: Sequence[_Worker[T]]) -> list[_Worker[T]]:
    """Wait up to POLL_S and return the workers that have sent a result or closed their pipe."""
    ready = wait([worker.answer for worker in workers], POLL_S) if workers else []
    return [worker for worker in workers if worker.answer in ready]


def _result(worker: _Worker[T]) -> Any:
    """Return the result of a worker that has ended, or None if the worker was interrupted."""
    try:
        result = worker.answer.recv()
    except EOFError:
        result = None
    worker.answer.close()
    worker.process.join()
    if result is None and worker.process.exitcode:
        return Lost(exit_code=worker.process.exitcode)
    return result
