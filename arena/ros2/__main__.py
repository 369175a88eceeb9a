"""Process of the ROS 2 bridge: `python -m arena.ros2 FILE.json`.

The file (slice) is the configuration of the process. No other process of the arena needs the bridge or waits for it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from arena.process_context import ProcessContext, run_and_close, run_process
from arena.ros2.bridge import Bridge

POLL_S = 0.005
"""Time between two polls [s]: the longest delay of a setpoint in the bridge."""
_REPORT_PERIOD_S = 1.0


class Ros2Process:
    """Process of the ROS 2 bridge with its main loop."""

    def __init__(self, room: ProcessContext) -> None:
        self._room = room
        self._bridge = Bridge(room.settings)
        self._reported = float("-inf")
        room.ready()

    def run(self) -> None:
        """Run the bridge until a stop signal arrives or the supervisor has died."""
        due = time.monotonic()
        while not self._room.stopping:
            now = time.monotonic()
            self._bridge.poll(now)
            for text in self._bridge.events():
                self._room.event(text)
            if now - self._reported >= _REPORT_PERIOD_S:
                self._reported = now
                self._room.stats(self._bridge.stats())
                if self._room.orphaned:
                    return
            due = max(due + POLL_S, now)
            time.sleep(max(0.0, due - time.monotonic()))

    def close(self) -> None:
        self._room.stats(self._bridge.stats())
        self._bridge.close()


def main(argv: list[str] | None = None) -> int:
    """Run the bridge process and return its exit code."""
    return run_process("arena:ros2", _make, argv)


def _make(room: ProcessContext) -> Callable[[], None]:
    return run_and_close(Ros2Process(room))


if __name__ == "__main__":
    sys.exit(main())
