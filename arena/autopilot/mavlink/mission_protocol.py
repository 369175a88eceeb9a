"""MAVLink's mission protocol for one vehicle, as PX4 v1.16 implements it.

Input: messages and the time. Output: messages. No sockets, no clock. A failed transfer leaves the stored list
unchanged.
"""

from __future__ import annotations

import struct
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
from arena.autopilot.navigation.mission_store import CAPACITY, MissionStore
from arena.wire.px4_messages import Px4Message

_CRITICAL, _INFO = 2, 6
_RETRY_S, _TIMEOUT_S, _PROGRESS_PERIOD_S, _TRANSFER_PERIOD_S = 0.25, 5.0, 1.0, 0.05
_REACHED_REPEATS = 10
_NO_MISSION_TOTAL = 65535
_IDLE, _RECEIVING, _SENDING = "idle", "receiving", "sending"
# Payloads with the extension fields of PX4's messages (opaque_id; mission_id, fence_id, rally_points_id), which pymavlink lacks
_ACK, _COUNT, _CURRENT = struct.Struct("<4BI"), struct.Struct("<H3BI"), struct.Struct("<2H2B3I")


@dataclass(slots=True)
class _Transfer:
    """State of the upload or download of a mission, geofence or rally point list on one link.

    partner: system and component id of the client
    kind: MAV_MISSION_TYPE
    seq: sequence number of the item expected next
    ints: whether to request items as MISSION_ITEM_INT; set once the partner has sent one
    received_at, sent_at: time of the last message received and sent [s]
    announced: current item and reached item last sent on this link
    repeats: how often the reached item was repeated
    progress_at: time of the next periodic MISSION_CURRENT [s]
    """

    state: str = _IDLE
    partner: tuple[int, int] = (0, 0)
    kind: int = MISSION
    seq: int = 0
    count: int = 0
    ints: bool = False
    received_at: float = 0.0
    sent_at: float = 0.0
    crc: int = 0
    items: list[Item] = field(default_factory=list)
    announced: tuple[int, int] = (0, -1)
    repeats: int = 0
    progress_at: float = 0.0


class MissionProtocol:
    """Uploads and downloads of mission, geofence and rally points of one vehicle, on all its links.

    due: time at which `update` must be called next [s]
    """

    def __init__(self, store: MissionStore, links: tuple[str, ...]) -> None:
        self.store = store
        self.due = 0.0
        self._seen_progress = 0
        self._texts: list[tuple[int, str]] = []
        self._links = {name: _Transfer() for name in links}
        self._out: list[tuple[str, Any]] = []
        self._uploading = False

    @property
    def has_progress(self) -> bool:
        """True if the vehicle has reached or begun a mission item since the last `update`."""
        return self.store.progress_changes != self._seen_progress

    # -- receiving -------------------------------------------------------------------------------------------

    def receive(self, link: str, m: Any, now: float) -> None:
        """Process one message of the mission protocol that is addressed to this vehicle.

        link: link on which it arrived
        now: time since boot [s]
        """
        self.due = 0.0
        _HANDLERS[m.get_msgId()](self, link, self._links[link], m, now)

    def _on_list(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        sender, kind = _sender(m), m.mission_type
        if t.state == _SENDING and t.seq == t.count:
            t.state = _IDLE  # every item was sent, but the acknowledgement was lost
        if t.state == _IDLE or (t.state == _SENDING and (t.kind, t.partner) == (kind, sender)):
            count = len(self.store.items.get(kind, ()))
            t.state, t.kind, t.partner, t.seq, t.count, t.received_at = _SENDING, kind, sender, 0, count, now
            payload = _COUNT.pack(count, *sender, kind, self.store.ids.get(kind, 0))
            self._send(link, Px4Message(mavlink.MAVLINK_MSG_ID_MISSION_COUNT, payload))
        else:
            self._texts.append((_INFO, "Mission download request ignored, already active"))

    def _on_request(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        t.ints = m.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        if _sender(m) != t.partner:
            self._report("WPM: REJ. CMD: partner id mismatch")
        elif t.state == _RECEIVING:
            self._report("WPM: REJ. CMD: Busy")
        elif t.state == _SENDING and m.mission_type == t.kind:
            self._answer_request(link, t, m.seq, now)

    def _answer_request(self, link: str, t: _Transfer, seq: int, now: float) -> None:
        t.received_at = now
        items = self.store.items.get(t.kind, ())
        expected = (seq == t.seq and t.seq < t.count) or (seq == t.seq - 1 and t.seq > 0)
        if not expected or seq >= len(items):
            t.state = _IDLE
            self._ack(link, t.partner, mavlink.MAV_MISSION_ERROR, t.kind)
            self._report("WPM: REJ. CMD: Req. WP was unexpected")
            return
        t.seq = seq + 1
        message = item_message(
            items[seq], seq, t.kind, t.partner, current=seq == self.store.current, ints=t.ints
        )
        self._send(link, message)

    def _on_ack(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        if _sender(m) != t.partner:
            self._report("REJ. WP CMD: partner id mismatch")
        elif t.state == _SENDING and m.mission_type == t.kind:
            t.state = _IDLE
        elif t.state == _RECEIVING and m.type == mavlink.MAV_MISSION_UNSUPPORTED:
            t.ints = not t.ints
            self._request(link, t, now)
        elif t.state == _RECEIVING and m.type == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            self._stop_upload(t)

    def _on_count(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        sender = _sender(m)
        if t.state == _IDLE:
            if self._uploading:  # on another link
                self._ack(link, sender, mavlink.MAV_MISSION_ERROR, m.mission_type)
                return
            refused = self._begin(t, sender, m)
            if refused is not None:
                self._ack(link, sender, refused, m.mission_type)
                return
        elif t.state == _SENDING:
            self._report("WPM: IGN MISSION_COUNT: Busy")
            self._ack(link, sender, mavlink.MAV_MISSION_ERROR, m.mission_type)
            return
        elif sender != t.partner or t.seq > 0:
            if sender == t.partner:
                self._report("WPM: REJ. CMD: Busy")
            self._ack(link, sender, mavlink.MAV_MISSION_ERROR, t.kind)
            return
        t.received_at = now
        self._request(link, t, now)

    def _begin(self, t: _Transfer, sender: tuple[int, int], m: Any) -> int | None:
        """Begin an upload after MISSION_COUNT. Return None, or the MAV_MISSION_RESULT if the upload ends at once.

        An upload ends at once if it is refused or has no items.
        """
        t.partner, t.kind, t.crc, t.seq = sender, m.mission_type, 0, 0
        if m.mission_type not in CAPACITY:
            return int(mavlink.MAV_MISSION_INVALID if m.count == 0 else mavlink.MAV_MISSION_NO_SPACE)
        if m.count > CAPACITY[m.mission_type]:
            return int(mavlink.MAV_MISSION_NO_SPACE)
        if m.count == 0:
            self.store.replace(m.mission_type, (), 0)
            return int(mavlink.MAV_MISSION_ACCEPTED)
        self._uploading = True
        t.state, t.count, t.items = _RECEIVING, m.count, []
        return None

    def _on_item(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        t.ints = m.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
        if _sender(m) != t.partner:
            self._report("REJ. MIS ITEM: partner id mismatch")
        elif m.mission_type != t.kind or t.state == _SENDING:
            self._ack(link, t.partner, mavlink.MAV_MISSION_ERROR, t.kind)
        elif t.state == _IDLE:
            self._repeated_item(link, t, m)
        else:
            t.received_at = now
            if m.seq == t.seq:
                self._store_item(link, t, m, now)

    def _repeated_item(self, link: str, t: _Transfer, m: Any) -> None:
        if t.seq > 0 and t.seq == m.seq + 1:  # the acknowledgement was lost
            self._ack(link, t.partner, mavlink.MAV_MISSION_ACCEPTED, t.kind, t.crc)
        else:
            self._report("IGN MISSION_ITEM: No transfer")
            self._ack(link, t.partner, mavlink.MAV_MISSION_ERROR, t.kind)

    def _store_item(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        item = item_of(m, ints=t.ints)
        refused = item if isinstance(item, int) else _refusal(item, t.kind)
        if isinstance(item, int):
            self._report("IGN MISSION_ITEM: Invalid item")
        if refused or isinstance(item, int):
            self._stop_upload(t)
            self._ack(link, t.partner, refused, t.kind)
            return
        t.crc = item_crc(m, t.crc, ints=t.ints)
        t.items.append(item)
        t.seq += 1
        if t.seq < t.count:
            self._request(link, t, now)
            return
        if t.crc != self.store.ids[t.kind]:
            self.store.replace(t.kind, tuple(t.items), t.crc)
        self._stop_upload(t)
        self._ack(link, t.partner, mavlink.MAV_MISSION_ACCEPTED, t.kind, t.crc)

    def _stop_upload(self, t: _Transfer) -> None:
        t.state, t.items = _IDLE, []
        self._uploading = False

    def _on_clear(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        if t.state != _IDLE:
            self._report("WPM: IGN CLEAR CMD: Busy")
            return
        for kind in (MISSION, FENCE, RALLY):
            if m.mission_type in (kind, ALL):
                self.store.replace(kind, (), 0)
        t.kind = m.mission_type
        self._ack(link, _sender(m), mavlink.MAV_MISSION_ACCEPTED, m.mission_type)

    def _on_set_current(self, link: str, t: _Transfer, m: Any, now: float) -> None:
        if t.state != _IDLE:
            self._report("WPM: IGN WP CURR CMD: Busy")
        elif m.seq < len(self.store.items[MISSION]):
            self.store.set_current(m.seq)
        else:
            self._report("WPM: WP CURR CMD: Not in list")

    # -- sending ---------------------------------------------------------------------------------------------

    def update(self, now: float) -> None:
        """Repeat item requests without a reply, end transfers that timed out, and send the mission progress.

        Call this method at time `due`, or earlier if `has_progress`.
        """
        self._seen_progress = self.store.progress_changes
        for name, t in self._links.items():
            self._announce_progress(name, t, now)
            if t.state == _RECEIVING and now - t.sent_at > _RETRY_S and now - t.received_at <= _TIMEOUT_S:
                self._request(name, t, now)
            elif t.state != _IDLE and now - t.received_at > _TIMEOUT_S:
                self._report("Operation timeout")
                self._stop_upload(t)
        busy = any(t.state != _IDLE for t in self._links.values())
        self.due = now + _TRANSFER_PERIOD_S if busy else min(t.progress_at for t in self._links.values())

    def _announce_progress(self, name: str, t: _Transfer, now: float) -> None:
        store = self.store
        total = len(store.items[MISSION])
        current, reached = t.announced
        fresh = False
        if current != store.current and total:
            self._send(name, self._current())
            fresh = True
        if reached != store.reached:
            t.repeats, fresh = 0, True
            if store.reached >= 0 and total:
                self._send(name, mavlink.MAVLink_mission_item_reached_message(store.reached))
        t.announced = (store.current, store.reached)
        if not fresh and now >= t.progress_at:
            t.progress_at = (
                now + _PROGRESS_PERIOD_S
                if now > t.progress_at + _PROGRESS_PERIOD_S
                else t.progress_at + _PROGRESS_PERIOD_S
            )
            self._send(name, self._current())
            if store.reached >= 0 and total and t.repeats < _REACHED_REPEATS:
                t.repeats += 1
                self._send(name, mavlink.MAVLink_mission_item_reached_message(store.reached))

    def take_messages(self) -> list[tuple[str, Any]]:
        """Remove and return the queued messages of the mission protocol, as (link name, message)."""
        found, self._out = self._out, []
        return found

    def take_texts(self) -> list[tuple[int, str]]:
        """Remove and return the queued texts for the user (STATUSTEXT), as (MAV_SEVERITY, text)."""
        texts, self._texts = self._texts, []
        return texts

    def _current(self) -> Px4Message:
        ids, total = self.store.ids, len(self.store.items[MISSION]) or _NO_MISSION_TOTAL
        payload = _CURRENT.pack(self.store.current, total, 0, 0, ids[MISSION], ids[FENCE], ids[RALLY])
        return Px4Message(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, payload)

    def _request(self, link: str, t: _Transfer, now: float) -> None:
        t.sent_at = now
        message = (
            mavlink.MAVLink_mission_request_int_message if t.ints else mavlink.MAVLink_mission_request_message
        )
        self._send(link, message(*t.partner, t.seq, t.kind))

    def _ack(self, link: str, to: tuple[int, int], result: int, kind: int, opaque_id: int = 0) -> None:
        payload = _ACK.pack(*to, int(result), kind, opaque_id)
        self._send(link, Px4Message(mavlink.MAVLINK_MSG_ID_MISSION_ACK, payload))

    def _send(self, link: str, message: Any) -> None:
        self._out.append((link, message))

    def _report(self, text: str) -> None:
        self._texts.append((_CRITICAL, text))


def _sender(m: Any) -> tuple[int, int]:
    return m.get_srcSystem(), m.get_srcComponent()


def _refusal(item: Item, kind: int) -> int:
    """Return MAV_MISSION_ERROR if an uploaded item must be refused, else 0.

    Refused are a fence or rally point command in a mission, and a fence polygon with fewer than 3 corners.
    """
    strange = kind == MISSION and item.command in (*FENCE_COMMANDS, mavlink.MAV_CMD_NAV_RALLY_POINT)
    few = kind == FENCE and item.command in POLYGONS and item.params[0] < 3
    return int(mavlink.MAV_MISSION_ERROR) if strange or few else 0


_Handler = Callable[[MissionProtocol, str, _Transfer, Any, float], None]
_HANDLERS: dict[int, _Handler] = {
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: MissionProtocol._on_list,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST: MissionProtocol._on_request,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT: MissionProtocol._on_request,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK: MissionProtocol._on_ack,
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT: MissionProtocol._on_count,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM: MissionProtocol._on_item,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT: MissionProtocol._on_item,
    mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: MissionProtocol._on_clear,
    mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT: MissionProtocol._on_set_current,
}
MESSAGE_IDS = tuple(_HANDLERS)
