"""Detector of repeated and reordered frames, and of restarts of the server, by frame numbers.

After a restart a server counts frames from the beginning. The detector distinguishes this from frames that
the network repeats or reorders.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    Place = Literal["new", "repeated", "restarted"]

_RESTART_COUNT = 9  # old numbers in a row, each greater than the one before: no network reorders so many


class FrameOrder:
    """Detector of repeated frames and of a restart of the motion-capture server, by the frame numbers.

    Each frame number is compared with the newest frame number. A single old frame is dropped. Nine old frames
    in a row mean that the server has restarted.
    """

    def __init__(self) -> None:
        self._begun = False
        self._newest = self._old = self._run = 0

    def place(self, number: int) -> Place:
        """Return whether a frame number is "new" or "repeated", or shows that the server has "restarted".

        - "new": greater than the newest number.
        - "repeated": not greater than the newest number.
        - "restarted": the server counts from the beginning again. This is the ninth number in a row that is not greater
          than the newest one, and each of the nine is greater than the one before.
        """
        if not self._begun or number > self._newest:
            self._begun, self._newest, self._run = True, number, 0
            return "new"
        self._run = self._run + 1 if self._run and number > self._old else 1
        self._old = number
        if self._run < _RESTART_COUNT:
            return "repeated"
        self._newest, self._run = number, 0
        return "restarted"
