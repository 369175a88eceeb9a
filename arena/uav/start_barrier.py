"""Barrier at which the programs of one run wait for each other, so that all start at the same time.

Each program writes a file with its time of arrival to the run's private folder. When all files are present,
every program reads the same times and waits for the same start time: 0.5 s after the last arrival, on the
clock that all programs share.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from arena.errors import InputError, RunError

START_DELAY_S = 0.5  # after the last arrival: longer than the 0.02 s between two looks at the folder


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
    """Access of one program to the start barriers, at which the programs of a run wait for each other.

    At a barrier, programs wait for each other, so that they start together.

    vehicle: name of the program's vehicle.
    folder: folder for the files of all programs of the run; None if `arena up` did not start the program.
    programs: vehicles of the run that have a program, with the same clock as this program. Other programs are ignored.
    """

    def __init__(self, vehicle: str, folder: Path | None, programs: Sequence[str]) -> None:
        self._vehicle, self._folder, self._programs = vehicle, folder, tuple(programs)
        self._uses: Counter[str] = Counter()

    def arrive(self, name: str, now: float, count: int | None = None) -> _Waiting:
        """Record that this program has arrived at the barrier `name`.

        A name may be used again: a program's second arrival waits for the second arrivals of the others.

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
            part = folder / f".{self._vehicle}"
            part.write_text(json.dumps(now))
            part.replace(folder / self._vehicle)
        except OSError as error:
            raise RunError(f"wait_for: cannot write in {folder}: {error.strerror}") from error
        return _Waiting(self._vehicle, folder, count, self._programs)


class _Waiting:
    """Arrival of one program at a start barrier, where it waits for the other programs.

    The object finds which programs have arrived. The arrival can be withdrawn after a timeout.
    """

    def __init__(self, vehicle: str, folder: Path, count: int, programs: Sequence[str]) -> None:
        self._vehicle, self._folder, self._count, self._programs = vehicle, folder, count, programs

    def arrivals(self) -> Arrivals:
        times = {}
        for file in self._folder.iterdir():
            if file.name in self._programs:
                times[file.name] = float(json.loads(file.read_text()))
        return Arrivals(times=times, count=self._count)

    def withdraw(self) -> str:
        """Remove the record of this program's arrival, because the program no longer waits.

        Return a text that names the arrived and the missing programs.
        """
        here = self.arrivals().times
        (self._folder / self._vehicle).unlink(missing_ok=True)
        missing = [name for name in self._programs if name not in here]
        return f"{len(here)} of {self._count} programs have arrived ({', '.join(sorted(here))}; missing: {', '.join(missing)})"
