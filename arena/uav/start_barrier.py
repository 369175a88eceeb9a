"""Barrier at which the programs of one run wait for each other, so that all start at the same time.

Each program writes a file with its time of arrival to the run's private folder, and keeps the file locked until it ends. When
all files are present, every program reads the same times and waits for the same start time: 0.5 s after the last arrival, on
the clock that all programs share.

A program may be started again in flight. It must not start alone, because of the old files of the others. So two kinds of arrivals
do not count: those of ended programs, whose files are not locked any more, and those of programs that have already started.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TextIO
from weakref import WeakSet

from arena.errors import InputError, RunError
from arena.whole_file import replace_file

_ROUNDING_S = 1e-6
START_DELAY_S = 0.5  # after the last arrival: longer than the 0.02 s between two looks at the folder
_barriers: WeakSet[StartBarrier] = WeakSet()
"""All barriers of this process. A forked child process closes its copies of their files."""


@dataclass(frozen=True, kw_only=True)
class Arrivals:
    """Record of the programs that have arrived at one barrier.

    times: vehicle -> time of arrival [s]. count: number of programs that must arrive.
    """

    times: dict[str, float]
    count: int

    @property
    def start_s(self) -> float | None:
        """Start time of all programs [s] on their common clock, or None until all have arrived."""
        if len(self.times) < self.count:
            return None
        return sorted(self.times.values())[self.count - 1] + START_DELAY_S


class StartBarrier:
    """Access of one program to the start barriers, at which the programs of a run wait for each other to start together.

    vehicle: name of the program's vehicle.
    folder: folder for the files of all programs of the run; None if `arena up` did not start the program.
    programs: vehicles of the run that have a program, with the same clock as this program. Other programs are ignored.
    """

    def __init__(self, vehicle: str, folder: Path | None, programs: Sequence[str]) -> None:
        self._vehicle, self._folder, self._programs = vehicle, folder, tuple(programs)
        self._uses: Counter[str] = Counter()
        self._files: list[TextIO] = []
        _barriers.add(self)

    def close(self) -> None:
        """Unlock the files of this program. Its arrivals do not count any more."""
        while self._files:
            self._files.pop().close()

    def arrive(self, name: str, now: float, count: int | None = None) -> _Waiting:
        """Record that this program has arrived at the barrier `name`.

        A name may be used again: a program's second arrival waits for the second arrivals of the others. A withdrawn arrival is not
        counted.

        count: number of programs that take part, including this program; None for all programs of the run.
        Raises InputError if the run has fewer programs, or if `arena up` did not start this program.
        """
        if self._folder is None:
            raise InputError(
                "wait_for: needs a program that `arena up` started, because it waits for the other programs of the run"
            )
        if not name.replace("-", "").replace("_", "").isalnum():
            raise InputError(f"wait_for: got the name {name!r}, expected letters, digits, - and _")
        count = len(self._programs) if count is None else count
        if not 1 <= count <= len(self._programs):
            programs = ", ".join(self._programs)
            raise InputError(
                f"wait_for: got n={count}, expected 1 to {len(self._programs)}, the number of programs in this run ({programs})"
            )
        self._uses[name] += 1
        folder = self._folder / f"{name}.{self._uses[name]}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _started_file(folder, self._vehicle).unlink(missing_ok=True)
            part = folder / f".{self._vehicle}"
            self._files.append(part.open("w"))
            fcntl.flock(self._files[-1], fcntl.LOCK_EX)
            self._files[-1].write(json.dumps(now))
            self._files[-1].flush()
            part.replace(folder / self._vehicle)
        except OSError as error:
            raise RunError(f"wait_for: cannot write in {folder}: {error.strerror}") from error
        return _Waiting(self._vehicle, now, folder, count, self._programs, partial(self._forget_use, name))

    def _forget_use(self, name: str) -> None:
        self._uses[name] -= 1


class _Waiting:
    """Arrival of one program at a start barrier, where it waits for the other programs.

    The object finds which programs have arrived. The arrival can be withdrawn after a timeout.
    """

    def __init__(
        self,
        vehicle: str,
        now: float,
        folder: Path,
        count: int,
        programs: Sequence[str],
        on_withdrawn: Callable[[], None],
    ) -> None:
        self._vehicle, self._now, self._folder = vehicle, now, folder
        self._count, self._programs, self._on_withdrawn = count, programs, on_withdrawn

    def arrivals(self) -> Arrivals:
        """Return the programs that have arrived and still wait, and this program."""
        times = {self._vehicle: self._now}
        for name in self._programs:
            since = None if name == self._vehicle else _waiting_since(self._folder / name)
            if since is not None and not self._has_started(name):
                times[name] = since
        return Arrivals(times=times, count=self._count)

    def _has_started(self, other: str) -> bool:
        """Return whether another program has started without waiting for this program."""
        return _started_s(self._folder, other) + _ROUNDING_S < self._now + START_DELAY_S

    def start(self, start_s: float) -> None:
        """Record the common start time, so that a program that arrives later does not count this arrival.

        start_s: [s]. Raises RunError if the file cannot be written.
        """
        file = _started_file(self._folder, self._vehicle)
        try:
            replace_file(file, json.dumps(start_s))  # as a whole: others may read at this moment
        except OSError as error:
            raise RunError(f"wait_for: cannot write {file}: {error.strerror}") from error

    def withdraw(self) -> str:
        """Remove the record of this program's arrival, because the program no longer waits. Call it once.

        Return a text that names the arrived and the missing programs. If the program arrives again, it meets the same programs.
        """
        self._on_withdrawn()
        here = self.arrivals().times
        (self._folder / self._vehicle).unlink(missing_ok=True)
        missing = [name for name in self._programs if name not in here]
        return f"{len(here)} of {self._count} programs have arrived ({', '.join(sorted(here))}; missing: {', '.join(missing)})"


def _waiting_since(file: Path) -> float | None:
    """Return the time of arrival in the file of a program [s]; None without a file, or if the program has ended."""
    try:
        found = file.open()
    except FileNotFoundError:
        return None
    with found:
        try:
            fcntl.flock(found, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:  # its program has locked it
            return float(json.loads(found.read()))
    return None


def _started_file(folder: Path, vehicle: str) -> Path:
    return folder / f".{vehicle}.started"


def _started_s(folder: Path, vehicle: str) -> float:
    """Return the start time that the program of a vehicle has read at a barrier [s]; infinite if it still waits."""
    try:
        return float(json.loads(_started_file(folder, vehicle).read_text()))
    except FileNotFoundError:
        return math.inf


def _close_all() -> None:
    """Close the files of all barriers in a forked child process, because only the program itself may keep them locked."""
    for barrier in list(_barriers):
        barrier.close()


os.register_at_fork(after_in_child=_close_all)
