"""Frame numbers off a network: repeated and reordered ones are told from a server that counts from the start again. Pure."""

from __future__ import annotations

from typing import Literal

Place = Literal["new", "repeated", "restarted"]

_RUN = 9  # old numbers in a row, each newer than the one before: no network reorders so many


class FrameOrder:
    """Remembers the newest number. One stray old frame is never believed; a run of them is a restarted server."""

    def __init__(self) -> None:
        self._newest: int | None = None
        self._old = 0
        self._run = 0

    def place(self, number: int) -> Place:
        """new: greater than any before. repeated: not so. restarted: not so for the ninth time in a row, and counting up."""
        if self._newest is None or number > self._newest:
            self._newest, self._run = number, 0
            return "new"
        self._run = self._run + 1 if self._run and number > self._old else 1
        self._old = number
        if self._run < _RUN:
            return "repeated"
        self._newest, self._run = number, 0
        return "restarted"
