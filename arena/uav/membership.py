"""Data with which a thread of a group finds the vehicles that its program flies. `UAV.from_args` reads these data."""

from __future__ import annotations

from collections.abc import Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Protocol

from arena.uav.group_clock import GroupThreads
from arena.uav.receiver import Receiver


class Closable(Protocol):
    """Connection that can be closed."""

    def close(self) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Membership:
    """The vehicles that one user program of a group flies, with their command lines and clocks.

    argv: command line for each vehicle: vehicle -> arguments without the program's name.
    once: whether the program flies all vehicles.
    threads: threads and clocks of the group. receiver: background thread of all its connections.
    opened: vehicles that the program has opened; they are closed when it ends.
    """

    argv: dict[str, Sequence[str]]
    once: bool
    threads: GroupThreads
    receiver: Receiver
    opened: list[Closable] = field(default_factory=list)


MEMBERSHIP: ContextVar[Membership | None] = ContextVar("membership", default=None)
"""Membership of the running thread; None for a program in a process of its own."""
