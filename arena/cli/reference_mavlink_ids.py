"""Reference page of the MAVLink system and component ids that arena's own programs use."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from arena.authority import role_of_tool
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID, SENDERS, VEHICLE_COMPONENTS, Sender

_HEAD = f"""\
# MAVLink ids

System and component ids of vehicles and of arena's own programs. An autopilot addresses its replies to the ids of the sender. So
two programs never have the same ids, and do not take each other's replies.

Vehicles have the system ids 1 to {LARGEST_VEHICLE_ID} (key `id`). Your own programs that send to a tools port should have other ids than
the programs in the second table.

## With the system id of the vehicle

"""
_PROGRAMS = """
## With a system id of their own

A range of components means that each process chooses one by its process id. *Signed*: component at a vehicle that signs its messages. It is
fixed, because such a vehicle accepts at most 16 senders until its next start. *Role*: who the sender is at a vehicle's tools port
([authority](../explanation/authority.md)).

"""


def mavlink_ids_page(table: Callable[[Iterable[str], Iterable[Iterable[str]]], str]) -> str:
    """Return the reference page of the MAVLink ids as Markdown.

    table: function that makes a table in Markdown from its head and its rows.
    """
    vehicles = ((str(number), *texts) for number, texts in sorted(VEHICLE_COMPONENTS.items()))
    return (
        _HEAD
        + table(("component", "sender", "note"), vehicles)
        + _PROGRAMS
        + table(("system", "component", "signed", "sender", "role", "purpose"), map(_row, SENDERS))
    )


def _row(sender: Sender) -> Iterable[str]:
    components = str(sender.first) if sender.first == sender.last else f"{sender.first} to {sender.last}"
    return (
        str(sender.system),
        components,
        str(sender.signed or ""),
        sender.program,
        role_of_tool(sender.system).words,
        sender.purpose,
    )
