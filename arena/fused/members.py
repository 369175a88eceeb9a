"""Members (parts) of the fused arena: router, motion capture, pose forwarders, recorder and sensors.

In each step of the world they run in a fixed order, so the same inputs give the same messages.
"""

from __future__ import annotations

import time as wall_time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from arena.clock_server import ClockServer
from arena.emulated_sensors.core import EmulatedSensors
from arena.emulated_sensors.settings import Settings
from arena.fused.captured_frames import FrameConverter
from arena.fused.forwarder_member import READY_TIMEOUT_S, ForwarderMember
from arena.fused.member import MemberContext
from arena.fused.memory_links import Inbox, MemoryCapture, RecorderLink, address
from arena.fused.router import FusedRouter
from arena.fused.step_time import StepTime
from arena.kernels.pose_selection import newest_poses
from arena.mocap.client import CapturedFrame
from arena.mocap.emulator.interface import MeasuredFrame
from arena.mocap.emulator.shell import EmulatorShell
from arena.pose_forwarder.shell import TICK_S
from arena.process_context import ProcessContext
from arena.recorder.flight_recorder import REPORT_PERIOD_S, FlightRecorder
from arena.recorder.truth_sampler import TruthSampler
from arena.sim.vehicle_links import Receive, VehicleLinks
from arena.simulation_speed import slowdown
from arena.socket_watch import SocketWatch
from arena.transport import Address
from arena.wire.pose_page import PosePageWriter
from arena.wire.truth_page import TruthReader

_EARLY_S = 1e-6  # simulation time advances in steps, which are not exact in binary


class Members:
    """All members (parts in one process) of the fused arena: router, motion capture, pose forwarders, sensors and recorder.

    The world is not a member: it calls the members in each step.

    The world uses this object as its MAVLink links (`LinkInterface`). Messages of built-in autopilots are exchanged in memory.
    Vehicles that PX4 flies, and the panic links (reserved for emergencies), use sockets.

    Normally, the process reports that it is ready when every member is ready. In two cases it reports this in the first step:
    with a vehicle that PX4 flies, because PX4 starts after the world; and in real time, because the members become ready late
    on a slow computer.

    process: context of the process.  slices: name of each member -> its configuration.
    budget_s: longest wall time for reading the panic links in one step [s].
    watch: finds the sockets with data; the world polls it in each step, before `drain`.
    clock: server of the simulation clock, on which the user programs sleep.
    """

    def __init__(
        self,
        process: ProcessContext,
        slices: Mapping[str, Mapping[str, Any]],
        *,
        budget_s: float,
        watch: SocketWatch,
        clock: ClockServer,
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
        self._capture = MemoryCapture()
        ready_limit_s = READY_TIMEOUT_S * slowdown(world.get("speed", 1.0))
        self._forwarders = {
            i: ForwarderMember(
                self._contexts[name],
                self._time,
                self._capture,
                i,
                self._inbox if i in in_memory else None,
                ready_limit_s,
            )
            for i, v in enumerate(vehicles)
            if (name := f"forward.{v['name']}") in self._contexts
        }
        self._router = FusedRouter(
            self._contexts["router"],
            self._time.now,
            frozenset(in_memory),
            self._inbox,
        )
        self._router.hold_for_sleepers(process.settings.get("sleepers", {}), clock.asleep)
        clock.before_wake = self._router.held.before_wake
        self._recorder = _Recorder(self._contexts["recorder"], self._time, self._router.sockets, truth)
        sensors = self._contexts.get("sensors")
        self._sensors = None if sensors is None else _Sensors(sensors, self._time, self._router)
        self._router.record_in(self._recorder.link, None if self._sensors is None else self._sensors.on_copy)
        mocap = self._contexts["mocap"]
        self._clock, self._joined = clock, 0
        self._served: list[ForwarderMember] = []  # with messages to read in this step
        self._all_forwarders = list(self._forwarders.values())
        self._selections = [forwarder.selection for forwarder in self._all_forwarders]
        self._with_sockets = [forwarder for forwarder in self._all_forwarders if forwarder.has_socket]
        self._next_tick = 0.0
        self._frames = FrameConverter(mocap.settings["bodies"])
        self._mocap = EmulatorShell(mocap, self._time.now(), self._on_frame)
        poses = process.settings.get("poses")
        self._poses = poses and PosePageWriter(poses, [str(b["name"]) for b in mocap.settings["bodies"]])
        self._watch = watch
        self._fds = _Fds(
            panic=self._panic.fileno(),
            mocap=self._mocap.fileno(),
            mocap_faults=self._mocap.faults.fileno(),
            router=self._router.fileno(),
            router_faults=self._router.faults.fileno(),
            references=self._recorder.link.fileno(),
        )
        for fd in self._fds:
            watch.add(fd)

    @property
    def ready(self) -> bool:
        """True if all members (router, recorder and so on) have reported that they are ready."""
        return all(context.is_ready for context in self._contexts.values())

    def drain(self, receive: Receive) -> None:
        """Read the waiting datagrams, and call `receive` with each datagram for an autopilot."""
        if self._joined != len(self._clock.joined):  # a new program may listen at a port that was closed
            self._joined = len(self._clock.joined)
            self._router.closed.search()
            self._mocap.search_receivers()
        if self._watch.has_data(self._fds.panic):
            self._panic.drain(receive)
        if self._watch.has_data(self._fds.router):
            self._router.drain(self._time.now())
        waiting = self._inbox[:]
        self._inbox.clear()
        for vehicle, link, data in waiting:
            receive(vehicle, link, data)

    def drain_panic(self, receive: Receive) -> bool:
        """Pass datagrams of the panic links (for emergencies only) to the autopilots.

        Return whether a datagram had arrived.
        """
        return self._panic.drain_panic(receive)

    def send(self, messages: list[tuple[int, str, bytes]], now: float) -> None:
        """Deliver the datagrams of the autopilots, and run all members (router, ...) for one simulation step.

        now: simulation time [s].
        """
        self._time.value = now
        at, deliver = -1, self._router.deliver
        while (at := deliver(messages, at + 1, now)) < len(messages):
            vehicle, link, data = message = messages[at]
            if link in ("router", "ground"):
                self._router.from_vehicle(vehicle, data, now, link)
            elif link == "panic":
                self._panic.send((message,))
            elif (forwarder := self._forwarders.get(vehicle)) is not None:
                forwarder.receive(data)
                self._served.append(forwarder)
        self._step(now)

    def _step(self, now: float) -> None:
        if self._ready_at_once:
            self._ready_at_once = False
            self._process.ready()
        has_data, fds = self._watch.has_data, self._fds
        if has_data(fds.mocap_faults):
            self._mocap.apply_faults()
        while self._mocap.due <= now + _EARLY_S:
            self._mocap.advance(now, requests=has_data(fds.mocap))
        self._forward(self._capture.poll(now), now)
        if self._sensors is not None:
            self._sensors.step(now)
        self._router.step(now, faults=has_data(fds.router_faults))
        self._recorder.step(now, references=has_data(fds.references))

    def _forward(self, frames: Sequence[CapturedFrame], now: float) -> None:
        """Send the newest pose of each vehicle, then read the messages that autopilots have sent to their pose forwarders.

        frames: oldest first.  now: simulation time [s].
        """
        forwarders = self._all_forwarders
        if frames:
            for k, pose in newest_poses(self._selections, frames, now):
                forwarders[k].send_pose(pose, now)
            self._served += self._with_sockets
        if now >= self._next_tick:
            self._next_tick = now + TICK_S
            for forwarder in forwarders:
                forwarder.step(now, True)
        else:
            for forwarder in self._served:
                forwarder.step(now, False)
        self._served.clear()

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Pass a request of the supervisor, such as `release`, to the router."""
        self._router.on_request(request, self._time.now())

    def stats(self) -> dict[str, int]:
        """Return the numbers of datagrams on the panic links.

        The router reports its numbers to the supervisor itself.
        """
        return self._panic.stats()

    def close(self) -> None:
        """Complete the recording, and close all sockets and files."""
        self._recorder.close()
        for forwarder in self._forwarders.values():
            forwarder.close()
        self._contexts["router"].stats(self._router.stats())
        self._router.close()
        self._mocap.close()
        self._panic.close()

    def _on_frame(self, frame: MeasuredFrame, now: float) -> None:
        captured = self._frames.convert(frame, now)
        if self._poses is not None:
            self._poses.write(captured.poses)
        self._capture.waiting.append(captured)
        if self._sensors is not None:
            self._sensors.on_frame(captured, now)
        self._recorder.on_frame(captured, now)


class _Fds(NamedTuple):
    """File descriptors of the members' sockets. They stay the same until the end of the run."""

    panic: int
    mocap: int
    mocap_faults: int
    router: int
    router_faults: int
    references: int


class _Sensors:
    """Emulated sensors, as a part of the fused arena instead of a process of their own.

    They receive telemetry as copies of the router's datagrams.
    """

    def __init__(self, context: MemberContext, time: StepTime, router: FusedRouter) -> None:
        self._context, self._time, self._router = context, time, router
        self._core = EmulatedSensors(Settings.of(context.settings))
        vehicles = self._core.settings.vehicles
        self._names = [v.name for v in vehicles]
        row_of = {v.serve: row for row, v in enumerate(vehicles) if v.estimated}
        self._row_of = {key: row_of[at] for key, at in enumerate(router.sockets) if at in row_of}
        self._next_report = 0.0
        context.ready()

    def on_frame(self, frame: CapturedFrame, now: float) -> None:
        self._core.on_frame(frame, True, now)

    def on_copy(self, socket: int, data: bytes) -> None:
        """Store the estimates (position, velocity, attitude) in a copied datagram of an autopilot.

        socket: index of the router's socket that sends it.
        """
        if (row := self._row_of.get(socket)) is not None:
            self._core.on_datagram(row, data, self._time.now())

    def step(self, now: float) -> None:
        """Pass the emulated sensors' measurements that are due in this simulation step to the router.

        now: simulation time [s].
        """
        for row, data in self._core.step(now):
            self._router.from_sensors(self._names[row], data, now)
        if now >= self._next_report:
            self._next_report = now + REPORT_PERIOD_S
            self._context.stats(self._core.stats())


class _Recorder:
    """Recorder, as a part of the fused arena instead of a process of its own.

    sockets: addresses of the router's sockets, in their order.
    """

    def __init__(
        self, context: MemberContext, time: StepTime, sockets: Sequence[Address], truth: TruthReader
    ) -> None:
        settings = context.settings
        self.link = RecorderLink(address(settings, "listen"), sockets, settings["vehicles"])
        self._time = time
        self._truth = TruthSampler(truth, float(settings["rate_hz"]), simulation_clock=True)
        self._recorder = FlightRecorder(context, time.now())
        self._next_tick = 0.0
        context.ready()

    def on_frame(self, frame: CapturedFrame, now: float) -> None:
        self._recorder.on_frame(frame, True, now)

    def step(self, now: float, *, references: bool = True) -> None:
        """Record the datagrams and true states of all vehicles in one simulation step.

        now: simulation time [s].  references: read the references of user programs from the socket.
        """
        if datagrams := self.link.receive(now, references=references):
            self._recorder.on_datagrams(datagrams)
        for time_s, truth in self._truth.due(now):
            self._recorder.on_truth(truth, time_s)
        self._recorder.tick(now, wall_time.monotonic())

    def close(self) -> None:
        """Record the last data, and close the recording."""
        self.step(self._time.now())
        self._recorder.close(self._time.now())
        self.link.close()


def _panic_only(vehicle: Mapping[str, Any]) -> dict[str, Any]:
    links = vehicle.get("links", {})
    return {"name": vehicle["name"], "links": {k: link for k, link in links.items() if k == "panic"}}
