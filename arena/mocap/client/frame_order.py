"""Order of frame numbers: distinguishes repeated and reordered frames from a server that starts again. Pure."""

from __future__ import annotations

from typing import Literal

Place = Literal["new", "repeated", "restarted"]

_RESTART_COUNT = 9  # old numbers in a row, each greater than the one before: no network reorders so many


class FrameOrder:
    """The newest frame number. A single old frame is dropped; nine in a row are a restarted server."""

    def __init__(self) -> None:
        self._newest: int | None = None
        self._old = 0
        self._run = 0

    def place(self, number: int) -> Place:
        """Classify a frame number.

        "new": greater than all before. "repeated": not greater. "restarted": the ninth in a row that is not greater, and rising.
        """
        if self._newest is None or number > self._newest:
            self._newest, self._run = number, 0
            return "new"
        self._run = self._run + 1 if self._run and number > self._old else 1
        self._old = number
        if self._run < _RESTART_COUNT:
            return "repeated"
        self._newest, self._run = number, 0
        return "restarted"
