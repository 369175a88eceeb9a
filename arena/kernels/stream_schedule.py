"""Schedule of MAVLink streams: which messages are due, and when each is sent next. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import floats, new_integers

if TYPE_CHECKING:
    from arena.kernels.arrays import Integers

_NEVER = float("inf")
_CATCH_UP_S = 0.1  # a late stream skips messages that are older than this
_ROUNDING_S = 1e-6
_JOIN_S = 0.008  # longest wait of a message for that of a faster stream


class StreamSchedule:
    """Schedule of the periodic messages (streams) on L MAVLink links.

    A stream is one message that one link sends periodically. A message waits up to 8 ms for the next message of a faster stream, so
    that both are sent in one datagram. The mean rates stay exact.

    ids: message ids in ascending order; one column of the arrays for each (S,)
    interval_s: period of each stream [s], 0 for a message that is not streamed (L, S)
    due_s: time of the next message [s], infinite for a message that is not streamed (L, S)
    order: columns of the messages of each link, the earliest first; of equal times the smaller id first (L, S)
    next_s: time of the next datagram of each link [s] (L,)
    """

    def __init__(self, links: int, ids: Integers) -> None:
        self.ids = ids
        self.interval_s = floats(links, len(ids))
        self.due_s, self.next_s = floats(links, len(ids), fill=_NEVER), floats(links, fill=_NEVER)
        self.order = new_integers(links, len(ids))
        for link in range(links):
            for column in range(len(ids)):
                self.order[link, column] = column

    def set_interval(self, link: int, column: int, interval_s: float, first_s: float) -> None:
        """Set the period of a message stream [s]; 0 stops the stream.

        first_s: time of the first message [s]
        """
        self.interval_s[link, column] = interval_s
        place = 0
        while self.order[link, place] != column:
            place += 1
        self._set_due(link, place, first_s if interval_s > 0.0 else _NEVER)

    def is_due(self, link: int, now: float) -> bool:
        """Return whether any message of a link must be sent at `now` [s]."""
        return self.next_s[link] <= now + _ROUNDING_S

    def is_any_due(self, begin: int, end: int, now: float) -> bool:
        """Return whether any message of the links from `begin` to `end` - 1 must be sent at `now` [s]."""
        first = _NEVER
        for link in range(begin, end):
            first = min(first, self.next_s[link])
        return first <= now + _ROUNDING_S

    def is_stream_due(self, link: int, column: int, now: float) -> bool:
        """Return whether one given message of a link must be sent at `now` [s]."""
        return self.due_s[link, column] <= now + _ROUNDING_S

    def due_column(self, link: int, place: int, now: float) -> int:
        """Return the column (index in `ids`) of a message that a link must send at `now` [s]; -1 if fewer are due.

        place: index of the message in the order of sending
        """
        if place == len(self.ids):
            return -1
        column = self.order[link, place]
        return column if self.is_stream_due(link, column, now) else -1

    def take_next(self, link: int, now: float) -> int:
        """Return the column (index in `ids`) of the first message that is due at `now` [s], and set its next time.

        Return -1 if no message of the link is due.
        """
        column = self.due_column(link, 0, now)
        if column >= 0:
            again = self.due_s[link, column] + self.interval_s[link, column]
            self._set_due(link, 0, max(again, now - _CATCH_UP_S))
        return column

    def take_due(self, link: int, now: float) -> list[int]:
        """Return the columns (indices in `ids`) of the messages that are due at `now` [s], and set their next times.

        The earliest is first. The list is empty while they wait for the message of a faster stream.
        """
        due: list[int] = []
        if not self.is_due(link, now):
            return due
        column = self.take_next(link, now)
        while column >= 0:
            due.append(column)
            column = self.take_next(link, now)
        return due

    def _set_due(self, link: int, place: int, due_s: float) -> None:
        """Set the time of the next message of a stream [s], and move the stream to its place in the order.

        place: index of the stream in the order before the change
        """
        order, column = self.order, self.order[link, place]
        self.due_s[link, column] = due_s
        while place > 0 and self._is_after(link, order[link, place - 1], due_s, column):
            order[link, place] = order[link, place - 1]
            place -= 1
        while place + 1 < len(self.ids) and not self._is_after(link, order[link, place + 1], due_s, column):
            order[link, place] = order[link, place + 1]
            place += 1
        order[link, place] = column
        self.next_s[link] = self._next_datagram_s(link)

    def _next_datagram_s(self, link: int) -> float:
        """Return the time of a link's next datagram [s].

        This is the due time of the fastest stream among those that are due at most `_JOIN_S` after the first one.
        """
        due_s, order = self.due_s, self.order
        fastest = order[link, 0]
        latest_s = due_s[link, fastest] + _JOIN_S
        for place in range(1, len(self.ids)):
            column = order[link, place]
            if due_s[link, column] > latest_s:
                break
            if self.interval_s[link, column] < self.interval_s[link, fastest]:
                fastest = column
        return due_s[link, fastest]

    def _is_after(self, link: int, other: int, due_s: float, column: int) -> bool:
        """Return whether a link sends the message of column `other` after a message that is due at `due_s` [s].

        column: of the message that is due at `due_s`. Of equal times the smaller column is first.
        """
        other_s = self.due_s[link, other]
        return other_s > due_s or (other_s == due_s and other > column)
