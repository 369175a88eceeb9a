"""Output channels for viewers: the recorder's data as messages for Foxglove and PlotJuggler.

They are in `flight.mcap` and, with `--foxglove`, on a WebSocket. The raw channels stay complete; these channels are limited
to the rates in `viewer_topics`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from foxglove.messages import Log

from arena.kernels.viewer_meters import GapMeter, Period, Throttle, count_poses, nanoseconds
from arena.kernels.viewer_telemetry import publish_datagrams
from arena.mocap.client import CapturedFrame
from arena.obstacles import Obstacle
from arena.recorder.channels import Datagram
from arena.recorder.mcap_file import MakeChannel
from arena.recorder.viewer_log import fault_of_event, log_of_event
from arena.recorder.viewer_output import Output
from arena.recorder.viewer_scene import Box, VehicleShape, room_scene
from arena.recorder.viewer_vehicle import VehicleChannels
from arena.wire.truth_rows import TrueStates, as_lists
from arena.wire.viewer_messages import pack_fault
from arena.wire.viewer_topics import ARENA_TOPICS, SCENE_PERIOD_S, SLOW_HZ, VIEW_HZ, Content

_PERIOD_S = 1.0 / SLOW_HZ
_MAX_MISSING_FRAMES = 1000  # a larger jump of the frame numbers is a restart of the server


@dataclass(frozen=True, kw_only=True)
class ViewedVehicle:
    """Vehicle whose data are published to viewers.

    name, id: name and MAV_SYS_ID.  body: name of its rigid body in the motion capture, None without one.
    index: its row in the truth page, None for a real vehicle.  shape: its dimensions, None if unknown.
    """

    name: str
    id: int
    body: str | None
    index: int | None
    shape: VehicleShape | None = None


class FoxgloveChannels:
    """Output channels of the recorder for Foxglove and PlotJuggler. No method blocks.

    The methods are those of `RecordChannels`.

    vehicles: vehicles of the arena.  channel: creates a channel in the record.
    size_m: size of the room, north, east, height [m].
    fence: smallest and largest north, east and height of the geofence [m]; None without a geofence.
    obstacles: fixed bodies in the room.
    """

    def __init__(
        self,
        vehicles: Sequence[ViewedVehicle],
        channel: MakeChannel,
        *,
        size_m: Sequence[float],
        fence: Box | None = None,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        self._size_m, self._fence, self._obstacles = size_m, fence, obstacles
        self._out = {content: Output(channel, content) for content in ARENA_TOPICS}
        self._vehicles = {
            v.name: VehicleChannels(
                channel, v.name, v.id, v.shape, self._out[Content.TRANSFORMS], self._send_log
            )
            for v in vehicles
        }
        self._telemetry = {name: v.telemetry for name, v in self._vehicles.items()}
        self._meters = {v.body: self._vehicles[v.name].poses for v in vehicles if v.body is not None}
        self._by_body = {v.body: self._vehicles[v.name] for v in vehicles if v.body is not None}
        self._by_index = [(v.index, self._vehicles[v.name]) for v in vehicles if v.index is not None]
        self._poses_due, self._truth_due = Throttle(1.0 / VIEW_HZ).due, Throttle(1.0 / VIEW_HZ).due
        self._frames = GapMeter()
        self._frame_number: int | None = None
        self._lost_frames = 0
        self._period = Period(_PERIOD_S)
        self._next_scene_s = 0.0

    def on_datagrams(self, datagrams: list[Datagram]) -> None:
        publish_datagrams(datagrams, self._telemetry, self._period, self._send_periodic)

    def on_frame(self, frame: CapturedFrame, simulated: bool, time_s: float) -> None:
        if self._period.ended(time_s):
            self._send_periodic(time_s)
        self._frames.add(time_s)
        if self._frame_number is not None:
            missing = frame.number - self._frame_number - 1
            self._lost_frames += missing if 0 < missing < _MAX_MISSING_FRAMES else 0
        self._frame_number = frame.number
        count_poses(frame.poses, self._meters, time_s)
        if self._poses_due(time_s):
            log_time = nanoseconds(time_s)
            for body, p_n, q_nb in frame.poses:
                if (vehicle := self._by_body.get(body)) is not None:
                    vehicle.on_pose(p_n, q_nb, log_time)

    def on_truth(self, truth: TrueStates, time_s: float) -> None:
        if self._period.ended(time_s):
            self._send_periodic(time_s)
        if not self._truth_due(time_s):
            return
        log_time = nanoseconds(time_s)
        p_n, q_nb = as_lists(truth.p_n), as_lists(truth.q_nb)
        for index, vehicle in self._by_index:
            vehicle.on_truth(p_n[index], q_nb[index], log_time)

    def on_event(self, line: bytes, fields: Mapping[str, Any], time_s: float) -> None:
        if (log := log_of_event(fields, time_s)) is not None:
            self._send_log(log, time_s)
        if (fault := fault_of_event(fields)) is not None:
            self._out[Content.FAULTS].send(pack_fault(*fault), time_s)

    def _send_log(self, log: Log, time_s: float) -> None:
        self._out[Content.LOG].send(log.encode(), time_s)

    def _send_periodic(self, time_s: float) -> None:
        """Publish the periodic messages, such as rates and the 3D scene, at the begin of a period.

        time_s: log time [s].
        """
        elapsed_s = self._period.elapsed_s
        if elapsed_s:
            self._send_rates(time_s, elapsed_s)
        if not elapsed_s or not -SCENE_PERIOD_S < time_s - self._next_scene_s < 0.0:
            self._send_scene(time_s)

    def _send_rates(self, time_s: float, period_s: float) -> None:
        for vehicle in self._vehicles.values():
            vehicle.send_rates(time_s, period_s)
        if not math.isnan(self._frames.newest_s):
            age = time_s - self._frames.newest_s
            rate, gap = self._frames.take(period_s)
            lost, self._lost_frames = self._lost_frames / period_s, 0
            self._out[Content.MOCAP_HEALTH].send_numbers(time_s, rate, lost, max(gap, age))

    def _send_scene(self, time_s: float) -> None:
        self._next_scene_s = time_s + SCENE_PERIOD_S
        room = room_scene(self._size_m, self._fence, time_s, self._obstacles)
        self._out[Content.SCENE].send(room.encode(), time_s)
        for vehicle in self._vehicles.values():
            vehicle.send_model(time_s)
