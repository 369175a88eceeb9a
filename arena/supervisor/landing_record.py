"""Reader of `emergency.jsonl` in the run folder, which records the commands of `arena land-all` and `arena kill-all`.

A landing is latched by the processes that pass commands to a vehicle: world, router and link process. A process that was still
starting, or did not run, has not received the command. It gets the recorded landing from the supervisor instead. Otherwise a
program that starts after land-all could arm the vehicle. A process that was ready has received the command, and has latched or
refused it. It does not get the recorded landing, except if a release of the vehicle was in progress at the time of the command:
the process may have received the release after the landing.
"""

from __future__ import annotations

import json
import math
import os
import stat
from collections import deque
from pathlib import Path
from typing import NamedTuple

from arena.background_writer import BackgroundWriter
from arena.plan.model import VehiclePlan
from arena.supervisor.missed_landings import Missed
from arena.supervisor.process_set import ProcessSet
from arena.supervisor.process_state import State
from arena.supervisor.release import guards, has_pilot
from arena.supervisor.release_task import ReleaseTask

_READ_S = 0.2
_READ_BYTES = 1 << 16
_STRENGTH = {"land-all": 3, "kill-all": 4}  # as in `Authority.standing`


class _Entry(NamedTuple):
    """Record of one command.

    at: time before the first command was sent, monotonic [s]. strength: 3 landing, 4 stop of the motors.
    """

    at: float
    strength: int
    vehicles: tuple[str, ...]


class LandingRecord:
    """Finds the recorded landings that processes of the run have missed, and sends the landings to these processes.

    folder: the run folder.
    release: landings before the last successful release of a vehicle are ignored. While a release is in progress, no landing of
        the vehicle is sent.
    files: thread that reads the file, because a disk that does not respond must not stop the supervisor.
    """

    def __init__(
        self, folder: Path, processes: ProcessSet, release: ReleaseTask, files: BackgroundWriter
    ) -> None:
        self._file = folder / "emergency.jsonl"
        self._processes, self._release, self._files = processes, release, files
        self._offset = 0
        self._next_read = float("-inf")
        self._found: deque[_Entry] = deque()
        self._unsent: list[Missed] = []

    def step(self, now: float) -> None:
        """Read new records, decide which processes have missed them, and send these landings. now: monotonic [s].

        The file is read all the time. A later read could not find out which processes were ready at the time of a record.
        """
        if now >= self._next_read:
            self._next_read = now + _READ_S
            self._files.submit(self._read, replaces=self._file.name)
        while self._found:
            self._take(self._found.popleft(), now)
        self._unsent = [missed for missed in self._unsent if not self._sent(missed)]

    def _take(self, entry: _Entry, now: float) -> None:
        at = min(entry.at, now)
        for vehicle in self._processes.plan.vehicles:
            name = vehicle.name
            released = at <= self._release.released.get(name, float("-inf"))
            if name not in entry.vehicles or released or self._refused_for_pilot(vehicle):
                continue
            may_be_cleared = self._release.was_in_progress(name, at)
            for guard in sorted(guards(self._processes.plan, name)):
                missed = Missed(guard, name, entry.strength)
                has_missed = may_be_cleared or self._may_have_missed(guard, at)
                if has_missed and self._processes.missed.add(missed, at):
                    self._unsent.append(missed)

    def _refused_for_pilot(self, vehicle: VehiclePlan) -> bool:
        """Return whether a landing is refused because a pilot has control. A simulated vehicle is landed nevertheless."""
        facts, last_facts = self._processes.facts, self._processes.last_facts
        return not vehicle.simulated and has_pilot(vehicle.name, facts, last_facts)

    def _may_have_missed(self, guard: str, at: float) -> bool:
        """Return whether a process was not ready all the time since `at`, monotonic [s].

        A process that has ended since then may have ended before `at`, because the supervisor notices the end late.
        """
        status = self._processes.statuses[guard]
        return status.state is not State.READY or status.since > at or status.stopped_at is not None

    def _sent(self, missed: Missed) -> bool:
        """Send a landing. Return False if it must be sent later.

        A process that does not run gets it at its start.
        """
        if missed not in self._processes.missed:
            return True
        if self._release.in_progress(missed.vehicle):
            return False
        if (child := self._processes.children.get(missed.guard)) is not None:
            child.send(missed.request, keep=True)
        return True

    def _read(self) -> None:
        """Read the complete lines that were added to the file. Runs in the background thread."""
        try:
            file = os.open(self._file, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        except OSError:
            return
        try:
            status = os.fstat(file)
            if not stat.S_ISREG(status.st_mode):
                return
            self._offset = min(self._offset, status.st_size)
            while text := os.pread(file, _READ_BYTES, self._offset):
                whole = text[: text.rfind(b"\n") + 1]
                if not whole and len(text) < _READ_BYTES:  # the last line is not complete
                    return
                self._offset += len(whole or text)
                self._found.extend(filter(None, map(_entry, whole.splitlines())))
        except OSError:
            return
        finally:
            os.close(file)


def _entry(line: bytes) -> _Entry | None:
    """Decode a line of the file. Return None if it is not a record of land-all or kill-all."""
    try:
        entry = json.loads(line)
        at, strength, vehicles = entry["mono"], _STRENGTH[entry["command"]], entry["vehicles"]
        if not (isinstance(at, int | float) and math.isfinite(at) and isinstance(vehicles, list)):
            return None
        return _Entry(float(at), strength, tuple(map(str, vehicles)))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
