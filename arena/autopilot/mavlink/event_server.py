"""MAVLink event protocol of one vehicle: numbers its events, keeps the newest, and sends them again on request.

As in PX4, the first event has the number FIRST, so that the 16-bit number wraps around soon, and the
CAPACITY newest events are kept. No links, no clock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple

from arena.autopilot.events import Event
from arena.wire import px4_messages

_ALSO_AN_EVENT = "\t"
CAPACITY = 20
FIRST = 65526
_NUMBERS = 1 << 16


class _Sent(NamedTuple):
    """Event that was sent. sequence: its number.  time_ms: its time since boot [ms]"""

    sequence: int
    time_ms: int
    event: Event

    def message(self) -> Any:
        return px4_messages.event(
            self.event.id, self.time_ms, self.sequence, self.event.levels, self.event.arguments
        )


class EventServer:
    """Server of the MAVLink event protocol: numbers the events of one vehicle, and sends them again on request.

    Every method returns MAVLink messages to send.
    """

    def __init__(self) -> None:
        self._newest = (FIRST - 1) % _NUMBERS
        self._kept: deque[_Sent] = deque(maxlen=CAPACITY)

    def send(self, events: Iterable[Event], time_ms: int) -> list[Any]:
        """Number new events and return the EVENT messages to send.

        time_ms: time since boot [ms]
        """
        messages = []
        for event in events:
            self._newest = (self._newest + 1) % _NUMBERS
            self._kept.append(_Sent(self._newest, time_ms, event))
            messages.append(self._kept[-1].message())
        return messages

    @property
    def newest(self) -> tuple[int, int]:
        """Sequence number of the newest event, and the flags of CURRENT_EVENT_SEQUENCE.

        Before the first event the flags report that the numbering begins again.
        """
        return self._newest, 0 if self._kept else px4_messages.SEQUENCE_RESET

    def requested(self, asked: px4_messages.EventRequest, system: int, component: int) -> list[Any]:
        """Return an EVENT message for each requested number, or RESPONSE_EVENT_ERROR if it is not stored.

        At most CAPACITY messages are returned: the request names numbers, not events, and may name all 65536.

        system, component: the client
        """
        kept = {sent.sequence: sent for sent in self._kept}
        messages: list[Any] = []
        for k in range(min((asked.last - asked.first) % _NUMBERS + 1, CAPACITY)):
            sequence = (asked.first + k) % _NUMBERS
            if sequence in kept:
                messages.append(kept[sequence].message())
            else:
                oldest = self._oldest_after(sequence)
                messages.append(px4_messages.response_event_error(sequence, oldest, system, component))
        return messages

    def _oldest_after(self, sequence: int) -> int:
        """Return the number of the stored event that follows number `sequence`.

        If no event is stored, return the newest number.
        """
        return min(
            (sent.sequence for sent in self._kept),
            key=lambda other: (other - sequence) % _NUMBERS,
            default=self._newest,
        )


def marked(texts: Iterable[tuple[int, str]], events: Iterable[Event]) -> list[tuple[int, str]]:
    """Add a tab (as in PX4) to each text that is also sent as an event, and return all texts.

    A ground station that knows events shows the event and drops the text. A text that says more than its event is
    not marked, so that it is always shown.
    """
    announced = {event.text for event in events}
    return [(severity, text + _ALSO_AN_EVENT if text in announced else text) for severity, text in texts]
