"""The world's step loop: autopilots and bodies step together, between the sockets and the wall clock. The
only shell of this room.

Each step: wait, hear the links, step the autopilots on what the sensors say, step the world, publish truth
and time, answer. Where autopilots are processes of their own (PX4) the order is turned by half a step, so that
they compute while this process publishes and the clock's clients work: send the sensors, wait for the clients,
publish truth and time, collect the motor commands, step the world. Either way published time does not move
while a client of the clock is awake.
"""

from __future__ import annotations

import gc
import math
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from arena.clock import ClockServer
from arena.errors import InputError, RunError
from arena.fault_injection import FaultReceiver
from arena.process_context import ProcessContext, ShutdownPolicy
from arena.sim.autopilot_interface import MakePilots, Outside
from arena.sim.fault_injection import spoil
from arena.sim.pacing import Pacer, own_core, speed_of
from arena.sim.vehicle_links import VehicleLinks
from arena.sim.world import World
from arena.wire.truth_page import Truth, TruthWriter

_LOOK_UP_S = 0.1  # how often the loop looks at its supervisor and passes events on
_STATS_S = 1.0
_DRAIN_SHARE = 0.3  # of a period's wall time, at most, for reading the links
_LONGEST_WAIT_S = 0.1
_MILLI_S = 1e-3
_RTF_TOLERANCE = 0.02


class Loop:
    """Owns everything that must be closed. `run` returns when the room is told to stop, or when its
    afterlife is over.
    """

    def __init__(self, room: ProcessContext, make_pilots: MakePilots) -> None:
        settings = room.settings
        self._room, self._speed = room, speed_of(settings.get("speed", 1.0))
        self._world = World(settings)
        self._pilots = make_pilots(settings, self._world.period_s)
        self._outside: Outside | None = self._pilots if isinstance(self._pilots, Outside) else None
        period_s = (
            self._world.period_s / max(self._speed, 1.0)
            if math.isfinite(self._speed)
            else self._world.period_s
        )
        self._keep_to_a_core(settings["vehicles"])
        self._links = VehicleLinks(settings["vehicles"], budget_s=_DRAIN_SHARE * period_s)
        self._truth_path = Path(settings["truth"])
        self._truth, self._clock = self._pages(settings["clock"])
        self._faults = self._listen(settings.get("faults"))
        self._afterlife = ShutdownPolicy()
        self._struck_off = 0

    def run(self) -> None:
        if self._outside is None:  # else the step itself begins with it
            self._publish(self._world.truth())
        self._step()
        # Everything made so far lives as long as the process: collections need not look at it again.
        gc.collect()
        gc.freeze()
        gc.disable()
        self._room.ready()
        self._serve()

    def close(self) -> None:
        """Tell the last figures and leave nothing behind: no socket, no page."""
        self._faults.close()
        self._clock.close()
        self._links.close()
        if (close := getattr(self._pilots, "close", None)) is not None:
            close()
        self._truth_path.unlink(missing_ok=True)
        self._world.close()

    def _keep_to_a_core(self, vehicles: list[dict[str, Any]]) -> None:
        outside = sum(v.get("autopilot", "builtin") != "builtin" for v in vehicles)
        core = own_core(tuple(os.sched_getaffinity(0)), speed=self._speed, outside=outside, pid=os.getpid())
        if core is not None:
            os.sched_setaffinity(0, {core})

    def _pages(self, clock: str) -> tuple[TruthWriter, ClockServer]:
        try:
            return TruthWriter(self._truth_path, self._world.fleet.size), ClockServer(clock)
        except OSError as error:
            for page in (self._truth_path, Path(f"{clock}.page"), Path(f"{clock}.sock")):
                page.unlink(missing_ok=True)
            raise RunError(
                f"cannot serve truth at {self._truth_path} and time at {clock}: {error}"
            ) from error

    def _listen(self, path: str | None) -> FaultReceiver:
        try:
            return FaultReceiver(path)
        except RunError:
            self._clock.close()
            self._truth_path.unlink(missing_ok=True)
            raise

    def _serve(self) -> None:
        now = time.monotonic()
        pacer = Pacer(period_s=self._world.period_s, speed=self._speed, now=now)
        next_look, next_stats = now, now + _STATS_S
        while not self._room.stopping:
            now = self._wait(pacer)
            pacer.begin(now)
            self._step()
            if now >= next_look:
                next_look = now + _LOOK_UP_S
                if self._look_up(now):
                    break
            if now >= next_stats:
                next_stats = now + _STATS_S
                self._room.stats(self._stats(pacer))
                self._complain(pacer)
                gc.collect()
        self._look_up(now)
        self._room.stats(self._stats(pacer))

    def _step(self) -> None:
        world, pilots = self._world, self._pilots
        self._links.drain(pilots.receive)
        if self._outside is None:
            self._take_faults()
            world.step(pilots.step(world.now, world.sense()))
            self._publish(world.truth())
        else:
            truth = world.truth()
            self._outside.see(truth)
            sensors = world.sense()
            if self._outside.wants_gps:
                sensors |= world.gps()
            self._outside.begin(world.now, sensors)
            world.watch()
            self._until_asleep()
            self._take_faults()
            self._publish(truth)
            world.move(self._outside.finish())
        self._links.send(pilots.transmit())

    def _take_faults(self) -> None:
        """At every step, when everybody who is awake has had his say and before anything moves."""
        for text in self._faults.apply(lambda fault: spoil(self._world, self._pilots, fault)):
            self._room.event(text)

    def _publish(self, truth: Truth) -> None:
        """Truth first: who is woken may read it."""
        self._truth.write(truth)
        self._clock.tick(self._world.now)

    def _until_asleep(self) -> None:
        """At another speed than the wall clock's, time waits for its clients."""
        if self._speed == 1.0:
            return
        while not (self._clock.may_pass(self._world.now, time.monotonic()) or self._room.stopping):
            self._clock.poll(_MILLI_S)
            self._take_faults()  # of many at once, only a few find room before they are taken

    def _wait(self, pacer: Pacer) -> float:
        """Until the next step may begin; returns the wall time then [s]. The clock's clients are served
        meanwhile.
        """
        now = time.monotonic()
        while (left := pacer.wait_s(now)) > 0.0 and not self._room.stopping:
            self._idle(min(left, _LONGEST_WAIT_S))
            now = time.monotonic()
        if self._outside is None:
            self._until_asleep()
            now = time.monotonic()
        return now

    def _idle(self, left_s: float) -> None:
        """Wait on the clock's sockets for whole milliseconds, which is what they can, and sleep the rest,
        which is sharp.
        """
        if left_s > 2.0 * _MILLI_S:
            self._clock.poll((math.floor(left_s / _MILLI_S) - 1) * _MILLI_S)
        else:
            time.sleep(left_s)

    def _look_up(self, now: float) -> bool:
        """Pass events on; True when the supervisor has died and no vehicle needs this world any more."""
        for text in (*self._world.events(), *self._pilots.events(), *self._strikes()):
            self._room.event(text)
            print(text, flush=True)  # the log is there when the supervisor is not
        return self._afterlife.over(
            orphaned=self._room.orphaned, any_armed=bool(np.any(self._pilots.armed)), now=now
        )

    def _complain(self, pacer: Pacer) -> None:
        """A line in the log for each second in which time did not go as it was asked to."""
        if math.isfinite(self._speed) and abs(pacer.rtf / self._speed - 1.0) > _RTF_TOLERANCE:
            rtf = f"real-time factor {pacer.rtf:.3f}, asked for {self._speed:g}"
            print(f"the second up to {self._world.now:.1f} s: {rtf}", flush=True)

    def _strikes(self) -> list[str]:
        names = self._clock.struck_off[self._struck_off :]
        self._struck_off += len(names)
        return [
            f"{name} has not slept on the clock for a second: the world no longer waits for it"
            for name in names
        ]

    def _stats(self, pacer: Pacer) -> dict[str, Any]:
        return {
            **pacer.stats(),
            "steps": self._world.steps,
            "sim_time_s": round(self._world.now, 3),
            "links": self._links.stats(),
            "vehicles": self._world.judge(),
            "autopilot": self._pilots.stats(),
        }


def serve(make_pilots: MakePilots, argv: list[str] | None = None) -> None:
    """Enter the room named by the slice in argv, and serve until told to stop. Raises ArenaError."""
    room = ProcessContext.enter(argv)
    try:
        loop = Loop(room, make_pilots)
    except KeyError as error:
        raise InputError(
            f"the slice of {room.name}: {error} is missing (docs/architecture.md, Slices)"
        ) from error
    try:
        loop.run()
    finally:
        loop.close()
