"""Exceptions of arena, and the exit codes of commands that fail with them.

    ArenaError                       1
    ├── InputError                   2   the YAML, a file or a command-line argument is wrong
    │   └── NotInstalledError        2   something the arena needs is not on this machine
    ├── RunError                     1   a process, vehicle or assertion failed
    ├── WireError                    1   received bytes violate their format
    └── VehicleError                 1   raised in user programs by arena.uav
        ├── SetpointError            1   a setpoint with the wrong shape, or not finite (also a ValueError)
        ├── CommandRefusedError      1   the autopilot refused a command
        ├── NotConfirmedError        1   the autopilot did not confirm a command in time
        ├── OffboardLostError        1   a pilot or a failsafe left OFFBOARD mode or disarmed
        └── StaleDataError           1   telemetry is older than allowed

Exit code 0 means success, 130 an interrupt (Ctrl-C).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

EXIT_OK = 0
EXIT_FAILED = 1
EXIT_INPUT = 2
EXIT_INTERRUPTED = 130


class ArenaError(Exception):
    """Base class of all exceptions of arena.

    exit_code: exit code of a command that fails with this exception.
    """

    exit_code = EXIT_FAILED


@dataclass(frozen=True, kw_only=True, order=True)
class Problem:
    """Error in an input file, with file and line. Problems are sorted by file and line.

    file: path as the user gave it.  line: 1-based, 0 if unknown.
    field: dotted YAML key, "" for the whole file.
    message: one line with the value found, the value expected and what to do.
    """

    file: str
    line: int
    field: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return f"{place}: {self.field}: {self.message}" if self.field else f"{place}: {self.message}"


class InputError(ArenaError):
    """Error in the YAML, in another file or on the command line.

    problems: every error that was found.
    """

    exit_code = EXIT_INPUT

    def __init__(self, problems: str | Problem | Sequence[Problem]) -> None:
        found: Sequence[Problem] = (
            () if isinstance(problems, str) else [problems] if isinstance(problems, Problem) else problems
        )
        self.problems = tuple(found)
        super().__init__(problems if isinstance(problems, str) else "\n".join(str(p) for p in self.problems))


class NotInstalledError(InputError):
    """Error for a missing program or package. The message says how to install it."""


class RunError(ArenaError):
    """Error of a run: a process, a vehicle or an assertion failed."""


class WireError(ArenaError):
    """Error for received bytes that violate their format.

    The message has the place, the value found and the value expected.
    """


class VehicleError(ArenaError):
    """Base class of the errors that `arena.uav` raises in user programs."""


class SetpointError(VehicleError, ValueError):
    """Error for a setpoint that has the wrong shape or contains a value that is not finite."""


class CommandRefusedError(VehicleError):
    """Error for a command that the autopilot has refused.

    The message contains the reason that the autopilot gave.
    """


class NotConfirmedError(VehicleError):
    """Error for a command that the autopilot did not confirm in time.

    It did not reply, or it did not reach the requested state.
    """


class OffboardLostError(VehicleError):
    """Error for a vehicle that left OFFBOARD, or was disarmed, without a command of the user program.

    It is not armed again automatically.
    """


class StaleDataError(VehicleError):
    """Error for reading telemetry that is older than its limit, or that was never received."""
