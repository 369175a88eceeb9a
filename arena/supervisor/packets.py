"""Helpers for the packets in which processes report to the supervisor.

They find the sender, limit the number of stored values, and describe the end of a user program.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from arena.plan.model import ProcessSpec

MAX_NAMES = 2000
"""Largest number of facts, and of measurements, that the supervisor stores for one process."""


def reporter(spec: ProcessSpec, packet: Mapping[str, Any]) -> tuple[str, str]:
    """Return the name and kind of a packet's sender: a process, or a member that runs inside a process.

    A process can run several members: the router, world and recorder of a simulated arena, or the programs of a group of
    vehicles. The key `of` of a packet names the member that has sent the packet.
    """
    for member in spec.members if "of" in packet else ():
        if member.name == packet["of"]:
            return member.name, member.kind
    return spec.name, spec.kind


def within_limit(values: Mapping[str, Any], known: Collection[str]) -> list[str]:
    """Return the names of received values that may be stored: known names, and new ones up to MAX_NAMES in total.

    A faulty process thus cannot fill the memory of the supervisor.
    """
    room, found = MAX_NAMES - len(known), []
    for key in values:
        if key not in known:
            room -= 1
        if key in known or room >= 0:
            found.append(key)
    return found


def program_ended(process: str) -> dict[str, str]:
    """Return the packet that reports to the world that a user program has ended.

    The world can wait before the first step until every program sleeps on the simulation clock. It does not wait for a program
    that has ended.

    process: name of the program's process: `program.uav1`, or `group.NAME`.
    """
    return {"do": "program_ended", "program": process.removeprefix("program.")}
