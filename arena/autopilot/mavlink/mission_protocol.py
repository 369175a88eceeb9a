"""The mission protocol from the vehicle's side, as PX4 v1.16 speaks it: uploads, downloads, what is current and reached.

One `Missions` a vehicle holds the three lists (mission, fence, rally) and one transfer's state a link. No sockets and no clock:
messages in with a time, messages out of `take_out`. A transfer that fails in the middle leaves the old list as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.navigation.mission_items import (
    ALL,
    FENCE,
    FENCE_COMMANDS,
    MISSION,
    POLYGONS,
    RALLY,
    Item,
    item_crc,
    item_message,
    item_of,
)

CAPACITY = {MISSION: 10000, FENCE: 64, RALLY: 32}
_CRITICAL, _INFO = 2, 6
_RETRY_S, _TIMEOUT_S, _SLOW_S, _BUSY_S = 0.25, 5.0, 1.0, 0.05
_REACHED_AGAIN = 10
_NO_TOTAL = 65535
_IDLE, _RECEIVING, _SENDING = "idle", "receiving", "sending"


class _Ack(mavlink.MAVLink_mission_ack_message):  # type: ignore[misc]
    """MISSION_ACK with the extension that this pymavlink does not know: opaque_id."""

    def __init__(self, to: tuple[int, int], result: int, kind: int, opaque_id: int) -> None:
        super().__init__(*to, result, kind)
        self._tail = opaque_id.to_bytes(4, "little")

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = (
            self.unpacker.pack(self.target_system, self.target_component, self.type, self.mission_type)
            + self._tail
        )
        return bytes(self._pack(mav, self.crc_extra, payload))


class _Count(mavlink.MAVLink_mission_count_message):  # type: ignore[misc]
    """MISSION_COUNT with opaque_id."""

    def __init__(self, to: tuple[int, int], count: int, kind: int, opaque_id: int) -> None:
        super().__init__(*to, count, kind)
        self._tail = opaque_id.to_bytes(4, "little")

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = (
            self.unpacker.pack(self.count, self.target_system, self.target_component, self.mission_type)
            + self._tail
        )
        return bytes(self._pack(mav, self.crc_extra, payload))


class _Current(mavlink.MAVLink_mission_current_message):  # type: ignore[misc]
    """MISSION_CURRENT with mission_id, fence_id and rally_points_id."""

    def __init__(self, seq: int, total: int, ids: dict[int, int]) -> None:
        super().__init__(seq, total)
        self._tail = b"".join(ids[kind].to_bytes(4, "little") for kind in (MISSION, FENCE, RALLY))

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = self.unpacker.pack(self.seq, self.total, self.mission_state, self.mission_mode) + self._tail
        return bytes(self._pack(mav, self.crc_extra, payload))


@dataclass(slots=True)
class _Transfer:
    """One link's side of the protocol. seq: expected next; ints: ask for MISSION_ITEM_INT, once the partner has shown that it has
    them; heard, sent: when last [s]."""

    state: str = _IDLE
    partner: tuple[int, int] = (0, 0)
    kind: int = MISSION
    seq: int = 0
    count: int = 0
    ints: bool = False
    heard: float = 0.0
    sent: float = 0.0
    crc: int = 0
    items: list[Item] = field(default_factory=list)
    told: tuple[int, int] = (0, -1)  # current and reached as this link knows them
    repeats: int = 0
    slow: float = 0.0


class Missions:
    """Lists, ids and transfers of one vehicle. current: index of the item being or to be flown; reached: the last, -1 for none.

    version: grows with each change of a list. moved: grows when `current` was set from outside. jumped: repeats left, by index.
    due: when `speak` has something to do [s]. valid: may the mission be flown, by whoever checks it.
    """

    def __init__(self, links: tuple[str, ...]) -> None:
        self.items: dict[int, tuple[Item, ...]] = {MISSION: (), FENCE: (), RALLY: ()}
        self.ids: dict[int, int] = {MISSION: 0, FENCE: 0, RALLY: 0}
        self.current, self.reached = 0, -1
        self.version, self.moved = 0, 0
        self.due = 0.0
        self.valid = False
        self.texts: list[tuple[int, str]] = []
        self._links = {name: _Transfer() for name in links}
        self._out: list[tuple[str, Any]] = []
        self._uploading = False

    # -- the flying side -----------------------------------------------------------------------------------------------

    def tell(self, *, current: int | None = None, reached: int | None = None) -> None:
        """The flight has come to another item, or reached one."""
        self.current = self.current if current is None else current
        self.reached = self.reached if reached is None else reached
        self.due = 0.0

    # -- hearing -------------------------------------------------------------------------------------------------------

    def hear(self, link: str, m: Any, now: float) -> None:
        """One message of the protocol, addressed to this vehicle."""
        self.due = 0.0
        _HANDLERS[m.get_msgId()](self, link, self._links[link], m, now)

    def _on_list(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        who, kind = _who(m), m.mission_type
        if t.state == _SENDING and t.seq == t.count:
            t.state = _IDLE  # all was sent, its acknowledgement was lost
        if t.state == _IDLE or (t.state == _SENDING and (t.kind, t.partner) == (kind, who)):
            count = len(self.items.get(kind, ()))
            t.state, t.kind, t.partner, t.seq, t.count, t.heard = _SENDING, kind, who, 0, count, now
            self._send(link, _Count(who, count, kind, self.ids.get(kind, 0)))
        else:
            self.texts.append((_INFO, "Mission download request ignored, already active"))

    def _on_request(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        t.ints = m.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        if _who(m) != t.partner:
            self._say("WPM: REJ. CMD: partner id mismatch")
        elif t.state == _RECEIVING:
            self._say("WPM: REJ. CMD: Busy")
        elif t.state == _SENDING and m.mission_type == t.kind:
            self._answer_request(link, t, m.seq, now)

    def _answer_request(self, link: str, t: _Transfer, seq: int, now: float) -> None:
        t.heard = now
        items = self.items.get(t.kind, ())
        expected = (seq == t.seq and t.seq < t.count) or (seq == t.seq - 1 and t.seq > 0)
        if not expected or seq >= len(items):
            t.state = _IDLE
            self._ack(link, t.partner, mavlink.MAV_MISSION_ERROR, t.kind)
            self._say("WPM: REJ. CMD: Req. WP was unexpected")
            return
        t.seq = seq + 1
        message = item_message(items[seq], seq, t.kind, t.partner, current=seq == self.current, ints=t.ints)
        self._send(link, message)

    def _on_ack(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        if _who(m) != t.partner:
            self._say("REJ. WP CMD: partner id mismatch")
        elif t.state == _SENDING and m.mission_type == t.kind:
            t.state = _IDLE
        elif t.state == _RECEIVING and m.type == mavlink.MAV_MISSION_UNSUPPORTED:
            t.ints = not t.ints
            self._ask(link, t, now)
        elif t.state == _RECEIVING and m.type == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            self._stop_upload(t)

    def _on_count(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        who = _who(m)
        if t.state == _IDLE:
            if self._uploading:  # by another link
                self._ack(link, who, mavlink.MAV_MISSION_ERROR, m.mission_type)
                return
            refused = self._begin(t, who, m)
            if refused is not None:
                self._ack(link, who, refused, m.mission_type)
                return
        elif t.state == _SENDING:
            self._say("WPM: IGN MISSION_COUNT: Busy")
            self._ack(link, who, mavlink.MAV_MISSION_ERROR, m.mission_type)
            return
        elif who != t.partner or t.seq > 0:
            if who == t.partner:
                self._say("WPM: REJ. CMD: Busy")
            self._ack(link, who, mavlink.MAV_MISSION_ERROR, t.kind)
            return
        t.heard = now
        self._ask(link, t, now)

    def _begin(self, t: _Transfer, who: tuple[int, int], m: Any) -> int | None:
        """Begin to receive; or the result that ends it at once."""
        t.partner, t.kind, t.crc, t.seq = who, m.mission_type, 0, 0
        if m.mission_type not in CAPACITY:
            return int(mavlink.MAV_MISSION_INVALID if m.count == 0 else mavlink.MAV_MISSION_NO_SPACE)
        if m.count > CAPACITY[m.mission_type]:
            return int(mavlink.MAV_MISSION_NO_SPACE)
        if m.count == 0:
            self._put(m.mission_type, (), 0)
            return int(mavlink.MAV_MISSION_ACCEPTED)
        self._uploading = True
        t.state, t.count, t.items = _RECEIVING, m.count, []
        return None

    def _on_item(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        t.ints = m.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
        if _who(m) != t.partner:
            self._say("REJ. MIS ITEM: partner id mismatch")
        elif m.mission_type != t.kind or t.state == _SENDING:
            self._ack(link, t.partner, mavlink.MAV_MISSION_ERROR, t.kind)
        elif t.state == _IDLE:
            self._late_item(link, t, m)
        else:
            t.heard = now
            if m.seq == t.seq:
                self._take_item(link, t, m, now)

    def _late_item(self, link: str, t: _Transfer, m: Any) -> None:
        if t.seq > 0 and t.seq == m.seq + 1:  # our acknowledgement was lost
            self._ack(link, t.partner, mavlink.MAV_MISSION_ACCEPTED, t.kind, t.crc)
        else:
            self._say("IGN MISSION_ITEM: No transfer")
            self._ack(link, t.partner, mavlink.MAV_MISSION_ERROR, t.kind)

    def _take_item(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        item = item_of(m, ints=t.ints)
        refused = item if isinstance(item, int) else _misplaced(item, t.kind)
        if isinstance(item, int):
            self._say("IGN MISSION_ITEM: Invalid item")
        if refused or isinstance(item, int):
            self._stop_upload(t)
            self._ack(link, t.partner, refused, t.kind)
            return
        t.crc = item_crc(m, t.crc, ints=t.ints)
        t.items.append(item)
        t.seq += 1
        if t.seq < t.count:
            self._ask(link, t, now)
            return
        if t.crc != self.ids[t.kind]:
            self._put(t.kind, tuple(t.items), t.crc)
        self._stop_upload(t)
        self._ack(link, t.partner, mavlink.MAV_MISSION_ACCEPTED, t.kind, t.crc)

    def _put(self, kind: int, items: tuple[Item, ...], crc: int) -> None:
        self.items[kind], self.ids[kind] = items, crc
        self.version += 1
        if kind == MISSION:
            marked = [k for k, item in enumerate(items) if item.current]
            self.current = marked[-1] if marked else max(0, min(self.current, len(items) - 1))
            self.reached = -1
            self.moved += 1

    def _stop_upload(self, t: _Transfer) -> None:
        t.state, t.items = _IDLE, []
        self._uploading = False

    def _on_clear(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        if t.state != _IDLE:
            self._say("WPM: IGN CLEAR CMD: Busy")
            return
        for kind in (MISSION, FENCE, RALLY):
            if m.mission_type in (kind, ALL):
                self._put(kind, (), 0)
        t.kind = m.mission_type
        self._ack(link, _who(m), mavlink.MAV_MISSION_ACCEPTED, m.mission_type)

    def _on_set_current(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        if t.state != _IDLE:
            self._say("WPM: IGN WP CURR CMD: Busy")
        elif m.seq < len(self.items[MISSION]):
            self.current = m.seq
            self.moved += 1
        else:
            self._say("WPM: WP CURR CMD: Not in list")

    # -- speaking ------------------------------------------------------------------------------------------------------

    def speak(self, now: float) -> None:
        """Retries, time-outs, and what is current and reached; to be called once `due` has come."""
        for name, t in self._links.items():
            self._tell_progress(name, t, now)
            if t.state == _RECEIVING and now - t.sent > _RETRY_S and now - t.heard <= _TIMEOUT_S:
                self._ask(name, t, now)
            elif t.state != _IDLE and now - t.heard > _TIMEOUT_S:
                self._say("Operation timeout")
                self._stop_upload(t)
        busy = any(t.state != _IDLE for t in self._links.values())
        self.due = now + _BUSY_S if busy else min(t.slow for t in self._links.values())

    def _tell_progress(self, name: str, t: _Transfer, now: float) -> None:
        total = len(self.items[MISSION])
        current, reached = t.told
        fresh = False
        if current != self.current and total:
            self._send(name, self._current())
            fresh = True
        if reached != self.reached:
            t.repeats, fresh = 0, True
            if self.reached >= 0 and total:
                self._send(name, mavlink.MAVLink_mission_item_reached_message(self.reached))
        t.told = (self.current, self.reached)
        if not fresh and now >= t.slow:
            t.slow = now + _SLOW_S if now > t.slow + _SLOW_S else t.slow + _SLOW_S
            self._send(name, self._current())
            if self.reached >= 0 and total and t.repeats < _REACHED_AGAIN:
                t.repeats += 1
                self._send(name, mavlink.MAVLink_mission_item_reached_message(self.reached))

    def take_out(self) -> list[tuple[str, Any]]:
        """(link, message) to send."""
        found, self._out = self._out, []
        return found

    def _current(self) -> _Current:
        return _Current(self.current, len(self.items[MISSION]) or _NO_TOTAL, self.ids)

    def _ask(self, link: str, t: _Transfer, now: float) -> None:
        t.sent = now
        ask = (
            mavlink.MAVLink_mission_request_int_message if t.ints else mavlink.MAVLink_mission_request_message
        )
        self._send(link, ask(*t.partner, t.seq, t.kind))

    def _ack(self, link: str, to: tuple[int, int], result: int, kind: int, opaque_id: int = 0) -> None:
        self._send(link, _Ack(to, int(result), kind, opaque_id))

    def _send(self, link: str, message: Any) -> None:
        self._out.append((link, message))

    def _say(self, words: str) -> None:
        self.texts.append((_CRITICAL, words))


def _who(m: Any) -> tuple[int, int]:
    return m.get_srcSystem(), m.get_srcComponent()


def _misplaced(item: Item, kind: int) -> int:
    """Fence commands have no place in a mission, and a polygon has three corners or more."""
    strange = kind == MISSION and item.command in (*FENCE_COMMANDS, mavlink.MAV_CMD_NAV_RALLY_POINT)
    few = kind == FENCE and item.command in POLYGONS and item.params[0] < 3
    return int(mavlink.MAV_MISSION_ERROR) if strange or few else 0


_Handler = Callable[[Missions, str, _Transfer, Any, float], None]
_HANDLERS: dict[int, _Handler] = {
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: Missions._on_list,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST: Missions._on_request,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT: Missions._on_request,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK: Missions._on_ack,
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT: Missions._on_count,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM: Missions._on_item,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT: Missions._on_item,
    mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: Missions._on_clear,
    mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT: Missions._on_set_current,
}
HEARD = tuple(_HANDLERS)
