"""Record of which vehicles a user program flies, for programs that run as threads of one process.

Such programs have no command line of their own, so `UAV.from_args` reads their arguments from `MEMBERSHIP`.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Protocol

from arena.uav.group_clock import GroupThreads
from arena.uav.receiver import Receiver


class Closable(Protocol):
    """Interface of a vehicle that a program has opened.

    `UAV` implements it, but cannot be imported here (circular import).
    """

    def close(self) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Membership:
    """Membership of one user program in a group: the vehicles that it flies, and the objects that all programs share.

    argv: command line for each vehicle: vehicle -> arguments without the program's name.
    once: whether the program flies all vehicles.
    threads: threads and clocks of all programs of the group.
    receiver: background thread and motion capture clients for all connections of the group.
    opened: vehicles that the program has opened; they are closed when it ends.
    """

    argv: dict[str, Sequence[str]]
    once: bool
    threads: GroupThreads
    receiver: Receiver
    opened: list[Closable] = field(default_factory=list)


MEMBERSHIP: ContextVar[Membership | None] = ContextVar("membership", default=None)
"""Membership of the running thread; None for a program in a process of its own."""
