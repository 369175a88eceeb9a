"""Record of the requests to a vehicle: who sent each request, and whether it was refused. Pure.

Setpoints and stick positions are not recorded, because they are repeated many times a second. A request that is repeated
within 5 s is recorded once.
"""

from __future__ import annotations

from typing import Any

from arena.authority.requests import Kind, Request
from arena.authority.roles import Role
from arena.transport import Source, source_text

_REPEAT_S = 5.0
_MAX_WAITING = 256  # entries that wait for the supervisor

Entry = dict[str, Any]


class AuditTrail:
    """Queue of the recorded requests to one vehicle, for events.jsonl.

    The supervisor writes the entries to the file.

    vehicle: name of the vehicle.
    lost: number of entries that did not fit in the memory for waiting entries.
    """

    def __init__(self, vehicle: str) -> None:
        self.lost = 0
        self._vehicle = vehicle
        self._entries: list[Entry] = []
        self._last: dict[tuple[Any, ...], float] = {}

    def add(
        self, role: Role, sender: tuple[int, int], request: Request, refusal: str, origin: Source, now: float
    ) -> None:
        """Record one request to the vehicle, with the reason if it was refused.

        Setpoints and stick positions are not recorded.

        sender: MAVLink system id and component id. refusal: why the request was refused, "" if it was sent on.
        origin: address of the sender, or name of its link. now: time of one clock [s].
        """
        if request.kind in (Kind.SETPOINT, Kind.MANUAL_INPUT):
            return
        same = role, sender, request, refusal, origin
        if now - self._last.get(same, -_REPEAT_S) < _REPEAT_S:
            return
        self._last = {key: at for key, at in self._last.items() if now - at < _REPEAT_S}
        self._last[same] = now
        if len(self._entries) >= _MAX_WAITING:
            self.lost += 1
            return
        what = f"{request.kind.value} {request.mode}{request.param}".rstrip()
        entry = {
            "vehicle": self._vehicle,
            "role": role.words,
            "sender": f"{sender[0]}/{sender[1]}",
            "from": source_text(origin),
        }
        self._entries.append({**entry, "request": what, "refused": refusal})

    def take(self) -> list[Entry]:
        """Remove and return the recorded requests, which the supervisor then writes to events.jsonl."""
        found, self._entries = self._entries, []
        return found
