"""Worker processes that carry out tasks in parallel, such as the flights of `arena smoke` and `arena campaign`.

If there are as many workers as CPU cores, each worker keeps to one core, with all processes of its arena: they mostly run in turns,
and find warm caches there.

Each worker has its own session, so Ctrl-C in the terminal reaches only this process, the runner. At the first Ctrl-C
the runner asks every worker to land and end its arena, at the second to end the arena at once. If a worker or the
runner is killed, the arenas end as well.

A worker is a copy of the runner, or a process of the fork server (`arena.smoke.flying.worker`). The second kind starts `arena up`
and all its processes by fork, so no flight imports packages.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import Any, Generic, TypeVar

from arena.constants import PROCESS_ENV
from arena.process_ties import set_death_signal
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.forked_child import ForkedChild

POLL_S = 0.2
CHANNEL_VARIABLE = "ARENA_WORKER_FD"
"""Environment variable with the number of the socket between runner and worker."""
_MODULE = "arena.smoke.flying.worker"
_STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, kw_only=True)
class Lost:
    """Marker for a worker process that ended without sending a result, for example because it was killed.

    exit_code: negative for a signal.
    """

    exit_code: int


@dataclass(kw_only=True)
class _Worker(Generic[T]):
    task: T
    cores: set[int]
    process: BaseProcess | ForkedChild
    answer: Connection

    def end(self) -> int:
        """Wait until the process has ended and return its exit code."""
        if isinstance(self.process, ForkedChild):
            return self.process.wait()
        self.process.join()
        return self.process.exitcode or 0


def run_all(
    tasks: Sequence[T],
    work: Callable[[T], R],
    *,
    jobs: int,
    on_end: Callable[[T, R | Lost], None],
    on_poll: Callable[[], None] = lambda: None,
    forks: ForkClient | None = None,
) -> None:
    """Carry out tasks in worker processes. Return when all tasks have ended.

    work: function that carries out one task. At an interruption, it raises KeyboardInterrupt.
    jobs: largest number of tasks at the same time.
    on_end: function that is called with each task that ended, and its result.
    on_poll: function that is called every POLL_S or more often.
    forks: fork server for the workers; tasks and `work` must be picklable. None: each worker is a copy of this process.
    Raises KeyboardInterrupt after Ctrl-C, when all workers have ended. If `on_end` raises an error, all workers are ended first.
    """
    waiting, workers = list(tasks), list[_Worker[T]]()
    everywhere = sorted(os.sched_getaffinity(0))
    keeps_to_one = min(jobs, len(tasks)) >= len(everywhere)
    with collected_stops() as stops:
        asked = 0
        try:
            while workers or (waiting and not stops):
                while waiting and len(workers) < jobs and not stops:
                    taken = [core for worker in workers for core in worker.cores]
                    cores = {min(everywhere, key=taken.count)} if keeps_to_one else set(everywhere)
                    workers.append(_begin(waiting.pop(0), work, cores, forks))
                for worker in _ended(workers):
                    workers.remove(worker)
                    if (result := _result(worker, asked=bool(stops))) is not None:
                        on_end(worker.task, result)
                on_poll()
                if len(stops) > asked:
                    asked = len(stops)
                    _terminate(workers)
        except BaseException:
            _end_all(workers, stops)
            raise
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


def _begin(task: T, work: Callable[[T], R], cores: set[int], forks: ForkClient | None) -> _Worker[T]:
    """Start a worker process for one task: with the fork server, or else as a fork of this process.

    A forked worker need not import the modules again.
    """
    if forks is not None and (forked := _fork(task, work, cores, forks)) is not None:
        return forked
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, os.getpid(), task, work, cores))
    process.start()
    theirs.close()
    return _Worker(task=task, cores=cores, process=process, answer=ours)


def _fork(task: T, work: Callable[[T], R], cores: set[int], forks: ForkClient) -> _Worker[T] | None:
    """Request a worker from the fork server and send it its task. Return None if no worker is started."""
    argv, cwd = [sys.executable, "-m", _MODULE], os.getcwd()  # noqa: PTH109
    if not forks.wait_until_ready() or not forks.serves(argv, is_program=False, cwd=cwd):
        return None
    ours, theirs = socket.socketpair()
    with theirs:
        pid = forks.fork(
            argv,
            cwd=cwd,
            env={**os.environ, **dict(PROCESS_ENV)},
            socket_variable=CHANNEL_VARIABLE,
            death_signal=signal.SIGTERM,
            output=sys.__stderr__.fileno() if sys.__stderr__ is not None else 2,
            channel=theirs.fileno(),
        )
    answer = Connection(ours.detach())
    if pid is None:
        answer.close()
        return None
    with contextlib.suppress(OSError):  # it has ended already: it is lost
        answer.send((task, work, cores))
    return _Worker(task=task, cores=cores, process=ForkedChild(pid), answer=answer)


def _work(answer: Connection, runner: int, task: T, work: Callable[[T], R], cores: set[int]) -> None:
    """Carry out a task, such as one flight, in a worker process that was forked from the runner.

    cores: CPU cores that the worker and its children use.
    """
    os.setsid()
    os.sched_setaffinity(0, cores)
    carry_out(answer, runner, task, work)


def carry_out(answer: Connection, runner: int, task: T, work: Callable[[T], R]) -> None:
    """Carry out a task in this worker process, and send the result to the runner.

    runner: pid of the runner. When it dies, this process gets SIGTERM.
    """
    for number in _STOPS:
        signal.signal(number, _interrupt)
    set_death_signal(signal.SIGTERM)
    if os.getppid() != runner:  # it died before the call above
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


def _end_all(workers: list[_Worker[T]], stops: Sequence[int]) -> None:
    """Ask all workers to end, wait until they have ended, and discard their results.

    They are asked again after each further Ctrl-C: then they end at once.
    """
    asked = -1
    while workers:
        if len(stops) > asked:
            asked = len(stops)
            _terminate(workers)
        for worker in _ended(workers):
            workers.remove(worker)
            _result(worker, asked=True)


def _terminate(workers: Sequence[_Worker[T]]) -> None:
    for worker in workers:
        worker.process.terminate()


def _result(worker: _Worker[T], *, asked: bool) -> Any:
    """Return the result of a worker that has ended.

    Return `Lost` for a worker without a result, for example if another process has killed it. Return None if the runner has asked it
    to end, and it has done so.

    asked: whether the runner has asked it to end.
    """
    try:
        result = worker.answer.recv()
    except (EOFError, OSError):  # it ended before or during its message
        result = None
    worker.answer.close()
    exit_code = worker.end()
    if result is None and (exit_code or not asked):
        return Lost(exit_code=exit_code)
    return result
