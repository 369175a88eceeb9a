"""List of the byte ranges of a file that were not received yet. Pure."""

from __future__ import annotations

from collections.abc import Iterable

Range = tuple[int, int]


class MissingRanges:
    """Missing bytes of a file, as sorted ranges (first byte, byte after the last byte).

    size: size of the file [byte]
    """

    def __init__(self, size: int, ranges: Iterable[Range] | None = None) -> None:
        """Create the list of missing ranges of a file.

        ranges: missing ranges of a file that exists in part; None if the whole file is missing.
        """
        self.size = size
        whole = [(0, size)] if ranges is None else sorted(ranges)
        self._ranges: list[Range] = [(max(a, 0), min(b, size)) for a, b in whole if a < min(b, size)]

    @property
    def ranges(self) -> tuple[Range, ...]:
        return tuple(self._ranges)

    @property
    def left(self) -> int:
        """Number of missing bytes."""
        return sum(b - a for a, b in self._ranges)

    def first(self, most: int) -> Range | None:
        """Return the first missing range, cut to at most `most` bytes; None if nothing is missing."""
        if not self._ranges:
            return None
        a, b = self._ranges[0]
        return a, min(b, a + most)

    def receive(self, first: int, end: int) -> bool:
        """Remove a received range from the list. Return whether a byte of this range was missing.

        first: first byte of the range. end: byte after its last byte.
        """
        if not self.is_missing(first, end):
            return False
        left: list[Range] = []
        for a, b in self._ranges:
            if b <= first or a >= end:
                left.append((a, b))
                continue
            left += [(a, first)] if a < first else []
            left += [(end, b)] if end < b else []
        self._ranges = left
        return True

    def is_missing(self, first: int, end: int) -> bool:
        """Return whether any byte from `first` to `end` (excluded) is missing."""
        return first < end and any(a < end and first < b for a, b in self._ranges)
