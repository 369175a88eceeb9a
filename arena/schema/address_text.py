"""Address of a vehicle as text, for the files push.json and missing_reboots.json. Pure."""

from __future__ import annotations

from arena.schema.arena import Arena, Vehicle


def address_text(arena: Arena, v: Vehicle) -> str:
    """Return the address of a vehicle as text, for the files of `arena params push`.

    Do not change the text, because existing records are compared with it.
    """
    if v.wire is None or v.simulated:
        return f"id {v.id}, simulated on {arena.address}"
    if v.wire.kind == "serial":
        return f"id {v.id}, serial {v.wire.device} at {v.wire.baud}"
    return f"id {v.id}, {v.wire}"
