"""Options that decide when a run ends, and the interface for showing its output to the user."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from arena.supervisor.messages import Message


class Show(Protocol):
    """Interface for the output of a run to the user. No method may raise an error or block."""

    def say(self, message: Message) -> None:
        """Show one line of output to the user."""

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Redraw the live table if its refresh period is over.

        status: function that returns the state to show.
        now: monotonic [s].
        """

    def blocked_s(self, now: float) -> float:
        """Return for how long the terminal has accepted no output [s].

        now: monotonic [s].
        """

    def started(self, failed: list[str]) -> None:
        """Report that the start of the arena is complete.

        Each process is ready or has failed.

        failed: one text per process that has failed.
        """


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of one run: when it ends, and who permits real vehicles to arm.

    until_done: end when every program has ended and every vehicle is disarmed.
    time_limit_s: end after this time [s]; None for no limit.
    adopt: become the parent of processes that detach from a program, so that they end with the program. Use it only in a
        process that has no other children.
    permit_by: who has permitted the real vehicles to arm, as text; "" if nobody has.
    """

    until_done: bool = False
    time_limit_s: float | None = None
    adopt: bool = False
    permit_by: str = ""
