"""`Steps`: generators for methods that wait. Each yields the times until which the program must sleep.

Blocking and asynchronous programs share this code.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

from arena.clock import Clock

T = TypeVar("T")
Steps = Generator[float, None, T]
"""Generator that yields the time until which the program must sleep [s], and returns the result of the method."""


def run(steps: Steps[T], clock: Clock) -> T:
    """Run a generator of type `Steps`: sleep on `clock` until each time that it yields. Return its result."""
    while True:
        try:
            due = next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        clock.sleep_until(due)
