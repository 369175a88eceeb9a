"""Schedule of MAVLink streams: which messages are due, and when each is sent next. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.arrays import Integers

_NEVER = float("inf")
_CATCH_UP_S = 0.1  # a late stream skips messages that are older than this
_ROUNDING_S = 1e-6


class StreamSchedule:
    """Schedule of the periodic messages (streams) on L MAVLink links.

    A stream is one message that one link sends periodically.

    ids: message ids in ascending order; one column of the arrays for each (S,)
    interval_s: period of each stream [s], 0 for a message that is not streamed (L, S)
    due_s: time of the next message [s], infinite for a message that is not streamed (L, S)
    next_s: the earliest of these times of each link [s] (L,)
    """

    def __init__(self, links: int, ids: Integers) -> None:
        self.ids = ids
        self.interval_s = floats(links, len(ids))
        self.due_s, self.next_s = floats(links, len(ids), fill=_NEVER), floats(links, fill=_NEVER)

    def set_interval(self, link: int, column: int, interval_s: float, first_s: float) -> None:
        """Set the period of a message stream [s]; 0 stops the stream.

        first_s: time of the first message [s]
        """
        self.interval_s[link, column] = interval_s
        self.due_s[link, column] = first_s if interval_s > 0.0 else _NEVER
        self.next_s[link] = self.due_s[link, self.first(link)]

    def is_due(self, link: int, now: float) -> bool:
        """Return whether any message of a link must be sent at `now` [s]."""
        return self.next_s[link] <= now + _ROUNDING_S

    def is_any_due(self, now: float) -> bool:
        """Return whether any message of any link must be sent at `now` [s]."""
        first = _NEVER
        for link in range(len(self.next_s)):
            first = min(first, self.next_s[link])
        return first <= now + _ROUNDING_S

    def is_stream_due(self, link: int, column: int, now: float) -> bool:
        """Return whether one given message of a link must be sent at `now` [s]."""
        return self.due_s[link, column] <= now + _ROUNDING_S

    def is_column_due(self, column: int, now: float) -> bool:
        """Return whether any link must send one given message at `now` [s]."""
        due = False
        for link in range(len(self.next_s)):
            due = due or self.is_stream_due(link, column, now)
        return due

    def first(self, link: int) -> int:
        """Return the column (index in `ids`) of the message that the link must send first.

        Of two messages with equal times it is the one with the smaller id.
        """
        earliest = 0
        for column in range(1, len(self.ids)):
            if self.due_s[link, column] < self.due_s[link, earliest]:
                earliest = column
        return earliest

    def take_due(self, link: int, now: float) -> list[int]:
        """Return the columns (indices in `ids`) of the messages that are due at `now` [s], and set their next times.

        The earliest is first.
        """
        due = []
        column = self.first(link)
        while self.due_s[link, column] <= now + _ROUNDING_S:
            due.append(column)
            again = self.due_s[link, column] + self.interval_s[link, column]
            self.due_s[link, column] = max(again, now - _CATCH_UP_S)
            column = self.first(link)
        self.next_s[link] = self.due_s[link, column]
        return due
