"""Reading of two clocks at the same instant, to convert the times of one clock to those of the other; id of the computer's boot."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

_CLOSE_S, _MOST_READINGS = 1e-4, 5


def read_together(clock: Callable[[], float]) -> tuple[float, float]:
    """Read a clock and the monotonic clock at the same instant. Return both times [s].

    On a busy computer, another process may run between two readings. Then both clocks are read again.
    """
    best, least_s = (math.nan, math.nan), math.inf
    for _ in range(_MOST_READINGS):
        before, found, after = time.monotonic(), clock(), time.monotonic()
        if after - before < least_s:
            best, least_s = (found, (before + after) / 2), after - before
        if least_s < _CLOSE_S:
            break
    return best


def boot_id() -> str:
    """Return the id that Linux gives to each boot of the computer; "" if it cannot be read.

    Monotonic times can be compared only within one boot.
    """
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""
