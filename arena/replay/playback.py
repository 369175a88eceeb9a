"""Selects the recorded messages to send at each time of a replay: speed, pause and jumps. Pure.

Two times are distinguished. The time of the record says where in the flight the replay is. The clock is the time that all processes
of the replay read: it never decreases. Both are equal until the first jump; after it they differ by `shift_ns`.

The clock advances from message to message, in steps of `STEP_NS` at most, so that programs can sleep on it as on the clock of the
simulated world.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from arena.replay.script import NS, Item, Kind, Script
from arena.replay.state_messages import StateMessages

STEP_NS = 4_000_000
"""Longest step of the clock [ns]."""
MAX_DELAY_S = 0.25
"""A replay that is later than this does not make up for the lost time [s of wall time]."""
LOOK_BACK_NS = 30 * NS
"""State messages are searched from this long before the time to which the replay jumps [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Result of `Playback.step`: the messages to send now, and the new times of the replay's clock and of the record.

    clock_ns: new time of the clock [ns].  record_ns: new time of the record [ns].
    items: messages to send, in this order.  jumped: the replay has jumped to this time of the record before the step.
    """

    clock_ns: int
    record_ns: int
    items: list[Item]
    jumped: bool = False

    @property
    def shift_ns(self) -> int:
        """Difference between the replay's clock and the recorded time [ns]."""
        return self.clock_ns - self.record_ns


class Playback:
    """Playback of recorded messages, with speed, pause and jumps.

    script: recorded messages.  start_ns: time of the record at which the replay begins [ns].
    speed: recorded seconds per second of wall time; inf for as fast as possible.  loop: begin again at the end.
    wall: wall time [s], monotonic; also in the methods.
    """

    def __init__(
        self,
        script: Script,
        *,
        wall: float,
        start_ns: int | None = None,
        speed: float = 1.0,
        loop: bool = False,
        paused: bool = False,
    ) -> None:
        self._script, self.loop, self.speed, self.paused = script, loop, speed, paused
        self.state = StateMessages(len(script.vehicles))
        begin = script.start_ns if start_ns is None else self._inside(start_ns)
        self.clock_ns = self.record_ns = begin
        self.finished = False
        self._jumped = False
        self._ready: list[Item] = []
        self._items: Iterator[Item] = iter(())
        self._next: Item | None = None
        self._seek(begin, whole=begin > script.start_ns)
        self._anchor(wall)

    def start(self, wall: float) -> None:
        """Start the playback now.

        wall: monotonic time [s].
        """
        self._anchor(wall)

    def wait_s(self, wall: float) -> float:
        """Return the wall time until the next step [s]. It is infinite while the replay is paused or finished.

        The step after a jump begins at once, also in a paused replay, so that viewers show the state after the jump.
        """
        if self._ready:
            return 0.0
        if self.paused or self.finished:
            return math.inf
        if math.isinf(self.speed):
            return 0.0
        due = self._anchor_wall + (self._target() - self._anchor_ns) / NS / self.speed
        if wall - due > MAX_DELAY_S:
            self._anchor_wall += wall - due
            return 0.0
        return due - wall

    def step(self, wall: float) -> Step:
        """Advance to the next time and return the messages to send.

        Call it only if `wait_s` has returned 0 or less.
        """
        target = self._target()
        self.clock_ns += target - self.record_ns
        self.record_ns = target
        items, self._ready = self._ready, []
        while self._next is not None and self._next.time_ns <= target:
            item, self._next = self._next, next(self._items, None)
            if item.kind is Kind.DOWN and isinstance(item.payload, bytes):
                self.state.take(item.vehicle, item.payload)
            items.append(item)
        jumped, self._jumped = self._jumped, False
        made = Step(clock_ns=self.clock_ns, record_ns=target, items=items, jumped=jumped)
        if self._next is None:
            self._at_end(wall)
        return made

    def pause(self, on: bool, wall: float) -> None:
        """Pause or continue the replay. Its clock stops during the pause.

        on: True to pause.
        """
        self.paused = on
        self._anchor(wall)

    def set_speed(self, speed: float, wall: float) -> None:
        """Set the speed: recorded seconds per second of wall time. inf means as fast as possible."""
        self.speed = speed
        self._anchor(wall)

    def seek(self, record_ns: int, wall: float) -> None:
        """Continue the replay at a different time of the record.

        The next step first sends the last state messages before this time. record_ns: log time [ns].  wall: monotonic time [s].
        """
        self.finished = False
        self._seek(self._inside(record_ns))
        self._jumped = True
        self._anchor(wall)

    def _seek(self, place: int, *, whole: bool = True) -> None:
        """Continue the playback with the recorded messages from a given recorded time on.

        place: this time [ns].
        whole: also collect the state messages before this time.
        """
        script = self._script
        self.state = StateMessages(len(script.vehicles))
        self._items = iter(script.items(max(script.start_ns, place - LOOK_BACK_NS) if whole else place))
        poses: dict[tuple[Kind, int], Item] = {}
        for item in self._items:
            if item.time_ns >= place:
                self._next = item
                break
            if item.kind is Kind.DOWN and isinstance(item.payload, bytes):
                self.state.take(item.vehicle, item.payload)
            elif item.kind in (Kind.TRUTH, Kind.FRAME):
                poses[item.kind, item.vehicle] = item
        else:
            self._next = None
        self._ready = [Item(place, Kind.DOWN, vehicle, frame) for vehicle, frame in self.state.all()]
        self._ready += [item._replace(time_ns=place) for item in poses.values()]
        self.record_ns = place

    def _target(self) -> int:
        """Return the recorded time that the next step will reach [ns]."""
        if self._ready or self._next is None:
            return self.record_ns
        return max(self.record_ns, min(self._next.time_ns, self.record_ns + STEP_NS))

    def _at_end(self, wall: float) -> None:
        if self.loop and self._script.end_ns > self._script.start_ns:
            self.seek(self._script.start_ns, wall)
        else:
            self.finished = True

    def _inside(self, place: int) -> int:
        return max(self._script.start_ns, min(place, self._script.end_ns))

    def _anchor(self, wall: float) -> None:
        self._anchor_wall, self._anchor_ns = wall, self.record_ns
