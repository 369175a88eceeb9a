"""Every exception that arena raises, and the exit code of each family.

    ArenaError                       1
    ├── InputError                   2   the YAML, a file or a command-line argument is wrong
    │   └── NotInstalledError        2   something the arena needs is not on this machine
    ├── RunError                     1   a process, vehicle or assertion failed
    ├── WireError                    1   bytes that are not what their format says
    └── VehicleError                 1   raised in user programs by arena.uav
        ├── SetpointError            1   a setpoint with the wrong shape, or not finite (also a ValueError)
        ├── CommandRefusedError      1   the autopilot said no, with its own reason
        ├── NotConfirmedError        1   the autopilot did not answer, or did not do it, in time
        ├── OffboardLostError        1   something else left OFFBOARD or disarmed: the pilot wins
        └── StaleDataError           1   a group of values is older than allowed

0 is success, 130 an interrupt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

EXIT_OK = 0
EXIT_FAILED = 1
EXIT_INPUT = 2
EXIT_INTERRUPTED = 130


class ArenaError(Exception):
    """Base of all. `exit_code` is what the command line ends with."""

    exit_code = EXIT_FAILED


@dataclass(frozen=True, kw_only=True, order=True)
class Problem:
    """A fault in an input; faults are ordered as they are read.

    file: path as the user gave it; line: 1-based, 0 when unknown; field: dotted key, "" for the file as a whole.
    message: what was found, what was expected and what to do, in one line.
    """

    file: str
    line: int
    field: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return f"{place}: {self.field}: {self.message}" if self.field else f"{place}: {self.message}"


class InputError(ArenaError):
    """The input is wrong. Carries every problem found, not just the first."""

    exit_code = EXIT_INPUT

    def __init__(self, problems: str | Problem | Sequence[Problem]) -> None:
        found: Sequence[Problem] = (
            () if isinstance(problems, str) else [problems] if isinstance(problems, Problem) else problems
        )
        self.problems = tuple(found)
        super().__init__(problems if isinstance(problems, str) else "\n".join(str(p) for p in self.problems))


class NotInstalledError(InputError):
    """Something the arena needs is not on this machine; the message says how to get it."""


class RunError(ArenaError):
    """A process, a vehicle or an assertion failed."""


class WireError(ArenaError):
    """Bytes that are not what their format says: where, what was found, what was expected."""


class VehicleError(ArenaError):
    """Base of what a user program can meet while flying."""


class SetpointError(VehicleError, ValueError):
    """A setpoint of the wrong shape or with a value that is not finite."""


class CommandRefusedError(VehicleError):
    """The autopilot refused a command; the message holds its own reason."""


class NotConfirmedError(VehicleError):
    """The autopilot did not confirm in time."""


class OffboardLostError(VehicleError):
    """Something other than the program left OFFBOARD or disarmed. Nothing re-arms by itself."""


class StaleDataError(VehicleError):
    """A group of values is older than its limit, or was never received."""
