"""The members of the fused arena around the world: router, motion capture, pose forwarders and loggers.

In each step of the world they run in a fixed order, so the same inputs give the same messages.
"""

from __future__ import annotations

import time as wall_time
from collections.abc import Mapping, Sequence
from typing import Any

from arena.clock import Rate
from arena.fused.captured_frames import FrameConverter
from arena.fused.member import MemberContext
from arena.fused.memory_links import Inbox, LoggerLink, MemoryCapture, VisionLink, address
from arena.fused.router import FusedRouter
from arena.mocap.emulator.interface import MeasuredFrame
from arena.mocap.emulator.shell import EmulatorShell
from arena.pose_forwarder.shell import TICK_S, ForwarderShell
from arena.process_context import ProcessContext
from arena.recorder.logger import Logger
from arena.sim.vehicle_links import Receive, VehicleLinks
from arena.wire.truth_page import TruthReader

READY_TIMEOUT_S = 30.0
"""Longest time for which the program of a PX4 vehicle waits until the vehicle can be armed, in wall time [s]."""
_EARLY_S = 1e-6  # simulation time advances in steps, which are not exact in binary


class Members:
    """Router, motion capture, pose forwarders and loggers of the fused arena: its members, all parts except the world.

    The world uses this object as its MAVLink links (`LinkInterface`). Messages of built-in autopilots are exchanged in memory.
    Vehicles that PX4 flies, and the panic links (reserved for emergencies), use sockets.

    Normally, the process reports that it is ready when every member is ready. In two cases it reports this in the first step:
    with a vehicle that PX4 flies, because PX4 starts after the world; and in real time, because the members become ready late
    on a slow computer.

    process: context of the process.  slices: name of each member -> its configuration.
    budget_s: longest wall time for reading the panic links in one step [s].
    """

    def __init__(
        self, process: ProcessContext, slices: Mapping[str, Mapping[str, Any]], *, budget_s: float
    ) -> None:
        world = slices["world"]
        vehicles = world["vehicles"]
        self._inbox: Inbox = []
        in_memory = [i for i, v in enumerate(vehicles) if v.get("autopilot", "builtin") == "builtin"]
        self._process = process
        self._ready_at_once = len(in_memory) < len(vehicles) or world.get("speed") == 1.0
        self._panic = VehicleLinks([_panic_only(v) for v in vehicles], budget_s=budget_s)
        self._time = StepTime()
        self._contexts = {
            name: MemberContext(process, dict(s)) for name, s in slices.items() if name != "world"
        }
        truth = TruthReader(world["truth"])
        self._loggers = [_Logger(self._contexts[f"logger.{v['name']}"], self._time, truth) for v in vehicles]
        self._forwarders = {
            i: _Forwarder(self._contexts[name], self._time, i, self._inbox if i in in_memory else None)
            for i, v in enumerate(vehicles)
            if (name := f"forward.{v['name']}") in self._contexts
        }
        self._router = FusedRouter(
            self._contexts["router"],
            self._time.now,
            frozenset(in_memory),
            self._inbox,
            {address(x.settings, "listen"): x.link.waiting.append for x in self._loggers},
        )
        mocap = self._contexts["mocap"]
        self._frames = FrameConverter(mocap.settings["bodies"])
        self._mocap = EmulatorShell(mocap, self._time.now(), self._on_frame)

    @property
    def ready(self) -> bool:
        """True if the router, the motion capture, and every pose forwarder and logger have reported that they are ready."""
        return all(context.is_ready for context in self._contexts.values())

    def drain(self, receive: Receive) -> None:
        """Pass the datagrams that have arrived to the autopilots."""
        self._panic.drain(receive)
        self._router.drain(self._time.now())
        waiting = self._inbox[:]
        self._inbox.clear()
        for vehicle, link, data in waiting:
            receive(vehicle, link, data)

    def drain_panic(self, receive: Receive) -> bool:
        """Pass datagrams to the autopilots as `drain` does, but only those of the panic links, which are reserved for emergencies.

        Return whether a datagram had arrived.
        """
        return self._panic.drain_panic(receive)

    def send(self, messages: Sequence[tuple[int, str, bytes]], now: float) -> None:
        """Deliver the datagrams that the autopilots send in this step, and run the members. now: simulation time [s]."""
        self._time.value = now
        for message in messages:
            vehicle, link, data = message
            if link == "router":
                self._router.from_vehicle(vehicle, data, now)
            elif link == "panic":
                self._panic.send((message,))
            elif vehicle in self._forwarders:
                self._forwarders[vehicle].receive(data)
        self._step(now)

    def _step(self, now: float) -> None:
        if self._ready_at_once:
            self._ready_at_once = False
            self._process.ready()
        self._mocap.apply_faults()
        while self._mocap.due <= now + _EARLY_S:
            self._mocap.advance(now)
        for forwarder in self._forwarders.values():
            forwarder.step(now)
        self._router.step(now)
        for logger in self._loggers:
            logger.step(now)

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Pass a request of the supervisor to the router."""
        self._router.on_request(request, self._time.now())

    def stats(self) -> dict[str, int]:
        """Return the numbers of datagrams on the panic links. The router reports its numbers to the supervisor itself."""
        return self._panic.stats()

    def close(self) -> None:
        """Write the rest of the logs, and close all sockets and files."""
        for logger in self._loggers:
            logger.close()
        for forwarder in self._forwarders.values():
            forwarder.close()
        self._contexts["router"].stats(self._router.stats())
        self._router.close()
        self._mocap.close()
        self._panic.close()

    def _on_frame(self, frame: MeasuredFrame, now: float) -> None:
        captured = self._frames.convert(frame, now)
        for forwarder in self._forwarders.values():
            forwarder.capture.waiting.append(captured)
        for logger in self._loggers:
            logger.capture.waiting.append(captured)


class _Forwarder:
    """Pose forwarder of one vehicle.

    vehicle: index in the world.  inbox: list that receives the datagrams for its autopilot; None: PX4, whose link is a socket.
    """

    def __init__(self, context: MemberContext, time: StepTime, vehicle: int, inbox: Inbox | None) -> None:
        self.capture = MemoryCapture()
        remote = address(context.settings["link"], "remote")
        self._link = None if inbox is None else VisionLink(vehicle, inbox, remote)
        self._context, self._shell = (
            context,
            ForwarderShell(context, time, self.capture, self._link, wall=time.now()),
        )
        self._next_tick, self._began = 0.0, wall_time.monotonic()

    def receive(self, data: bytes) -> None:
        """Store a datagram from the built-in autopilot until `step` reads it."""
        if self._link is not None:
            self._link.waiting.append(data)

    def step(self, now: float) -> None:
        """Send a pose if one is due, and read the autopilot's messages. now: simulation time [s]."""
        due = now >= self._next_tick
        if self.capture.waiting or (due if self._link is None else self._link.waiting):
            self._shell.turn(now)
        if due:
            self._next_tick = now + TICK_S
            self._shell.tick(now, now)
            if self._link is None and not self._context.is_ready:
                self._limit_wait()

    def close(self) -> None:
        """Close the link on which the autopilot receives poses."""
        self._shell.link.close()

    def _limit_wait(self) -> None:
        """Report the pose forwarder as ready after 30 s of wall time even if PX4 cannot be armed. The user program then starts
        and reports why PX4 cannot be armed.
        """
        if wall_time.monotonic() - self._began > READY_TIMEOUT_S:
            vehicle = self._context.settings["vehicle"]
            self._context.event(
                f"{vehicle}: PX4 cannot be armed {READY_TIMEOUT_S:g} s after the start; the user program starts now"
            )
            self._context.ready()


class _Logger:
    def __init__(self, context: MemberContext, time: StepTime, truth: TruthReader) -> None:
        self.settings = context.settings
        self.capture, self.link = MemoryCapture(), LoggerLink(address(context.settings, "listen"))
        self._logger = Logger(context, time, self.capture, self.link, truth)
        self._period_s = 1.0 / float(self.settings["rate_hz"])
        self._rows = 0
        context.ready()

    def step(self, now: float) -> None:
        """Write a row of the vehicle's log if the time for the next row has come."""
        if now + _EARLY_S >= self._rows * self._period_s:
            self._rows = int((now + _EARLY_S) / self._period_s) + 1
            self._logger.step(now)

    def close(self) -> None:
        self._logger.close()


class StepTime:
    """Clock of the router, pose forwarders and loggers in the fused arena. It returns the time of the present step.

    The world calls these members in each step. A member that slept would stop the world, so this clock cannot sleep.

    value: simulation time [s].
    """

    def __init__(self) -> None:
        self.value = 0.0

    def now(self) -> float:
        """Return the simulation time [s]."""
        return self.value

    def sleep_until(self, t: float) -> float:
        raise NotImplementedError(
            "StepTime cannot sleep: the world calls every member in each step, and a member that sleeps would stop the world"
        )

    def rate(self, hz: float) -> Rate:
        raise NotImplementedError(
            "StepTime cannot sleep: the world calls every member in each step, and a member that sleeps would stop the world"
        )


def _panic_only(vehicle: Mapping[str, Any]) -> dict[str, Any]:
    links = vehicle.get("links", {})
    return {"name": vehicle["name"], "links": {k: link for k, link in links.items() if k == "panic"}}
