"""ULog recorder of the built-in autopilots: decides when a log begins and ends, and encodes it. Pure."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from arena import __version__
from arena.autopilot.commander import Commander
from arena.autopilot.ulog.flight_state import FlightState
from arena.autopilot.ulog.layout import Layout
from arena.autopilot.ulog.message_formats import FORMATS
from arena.autopilot.ulog.quantities import Quantities, Sources
from arena.autopilot.ulog.topics import STATE, TOPICS
from arena.autopilot.vehicle import Vehicle
from arena.builtin_parameters import SPECS
from arena.geometry import EARTH_M
from arena.kernels.arrays import array
from arena.kernels.global_coordinates import global_position
from arena.wire import ulog_messages as ulog

Array = NDArray[np.float64]
_DISABLED, _ARMED, _BOOT, _BOOT_TO_END, _ARMED_TO_END = -1, 0, 1, 2, 4  # SDLOG_MODE
_TAIL_S = 0.1  # from disarming to the end of the log: the last texts arrive
_HAND_OVER_S = 0.25  # between two times at which bytes are passed on
_VISION_PERIOD_S, _OFFBOARD_PERIOD_S = 0.03, 0.1
_NEVER = -1e9
_NAN3 = (math.nan,) * 3
INFO: dict[str, str | int] = {
    "sys_name": "arena built-in autopilot (not PX4)",
    "ver_sw": f"arena {__version__}",
    "ver_sw_release": 0x011000FF,  # as in AUTOPILOT_VERSION: PX4 1.16.0, whose topics and parameters are used
    "ver_hw": "ARENA_BUILTIN",
    "ver_data_format": 2,
}


class Sink(Protocol):
    """Interface through which the recorder stores the log data, for example `UlogFiles`.

    No method waits for a disk.
    """

    def begin(self, name: str, data: bytes) -> None:
        """Begin a new log file of a vehicle.

        name: of the vehicle. data: header and definitions
        """
        ...

    def write(self, name: str, data: bytes) -> None:
        """Add bytes to the current log of a vehicle."""
        ...

    def end(self, name: str) -> None:
        """End the current log of a vehicle."""
        ...

    def hand_over(self, now: float) -> None:
        """Store the received log data on the disk, if enough time has passed since the last write.

        This is called four times per simulated second. now: time since boot [s]
        """
        ...

    def events(self) -> list[str]:
        """Return lines for the event log about failed writes since the last call."""
        ...

    def close(self) -> None:
        """Store all received log data before the process ends."""
        ...


class UlogRecorder:
    """Recorder of the ULog files of V vehicles.

    A log begins and ends as SDLOG_MODE requires: 0 from arming to disarming, 1 from boot to disarming, 2 from boot, 4 from arming.
    Mode 2 and 4 end with the process. A vehicle that arms again gets a new log.
    """

    def __init__(self, sources: Sources, sink: Sink) -> None:
        self._s, self._sink = sources, sink
        count = len(sources.vehicles)
        self._quantities = Quantities(sources)
        self._layout = Layout(count, sources.dt, self._quantities.law)
        self._state = FlightState(sources, self._layout.state)
        self._every = max(1, round(_HAND_OVER_S / sources.dt))
        self._step, self._at = 0, 0
        self._open = [False] * count
        self._taken = [0] * count  # bytes of the row that were already passed on
        self._keys: list[tuple[object, ...]] = [()] * count
        self._end_at = [math.inf] * count
        self._vision_at, self._offboard_at = [_NEVER] * count, np.full(count, _NEVER)
        self._home: list[object] = [None] * count
        self._homes = [0] * count
        self._now = 0.0
        self._definitions = _definitions()
        self._parameters = ulog.ParameterMessages(
            {name: spec.type for name, spec in SPECS.items()},
            {name: spec.default for name, spec in SPECS.items()},
        )
        self._params_version = -1
        self._values: dict[str, Array] = {}
        self._any = False
        self._modes: list[int] = []

    # -- every step ------------------------------------------------------------------------------------------

    def step(self, now: float, sensors: Mapping[str, Array]) -> None:
        """Fill the ULog records of one step (one sensor period) of all vehicles.

        now: time since boot [s]
        sensors: see `Autopilots.step`
        """
        self._now = now
        if not self._any:
            return
        due = self._layout.steps[self._step]
        if due.uses_vehicles:
            self._quantities.read_vehicles()
        if due.uses_sensors:
            self._quantities.read_sensors(sensors)
        self._layout.law.write(self._step, now, round(1e6 * now))
        self._at = due.end
        self._step += 1
        if self._step == len(self._layout.steps):
            self._pass_on_all()
            self._step = self._at = 0
            self._taken = [0] * len(self._taken)
        elif self._step % self._every == 0:
            self._pass_on_all()

    def _pass_on_all(self) -> None:
        for i, is_open in enumerate(self._open):
            if is_open:
                self._pass_on(i)
        self._sink.hand_over(self._now)

    def _pass_on(self, i: int, more: bytes = b"") -> None:
        """Pass the new ULog records of vehicle i to the sink, which stores them.

        more: bytes to add after the records
        """
        data = self._layout.rows[i, self._taken[i] : self._at].tobytes() + more
        self._taken[i] = self._at
        if data:
            self._sink.write(self._s.vehicles[i].commander.name, data)

    # -- decisions -------------------------------------------------------------------------------------------

    def decide(self, now: float, decided: Sequence[int]) -> None:
        """Begin and end the logs of the vehicles, and record changes of mode, arming, parameters and setpoints.

        This is called every 0.02 s. now: time since boot [s].  decided: vehicles whose commander has just decided
        """
        self._now = now
        if self._params_version != self._s.params.version:
            self._record_parameters()
        changed = self._state.begin(now)
        for i in sorted({*decided, *changed}) if changed else decided:
            v = self._s.vehicles[i]
            if self._open[i] != self._is_wanted(i, v.commander, now):
                self._switch(i)
            v.is_logged = self._open[i]
            if self._open[i]:
                self._record_changes(i, v, now)
        self._record_offboard(now)

    def _is_wanted(self, i: int, commander: Commander, now: float) -> bool:
        """Return whether vehicle i must be logged now, according to SDLOG_MODE and its arming state."""
        mode, armed = self._modes[i], commander.armed
        if mode == _DISABLED:
            return False
        if armed:
            self._end_at[i] = math.inf
            return mode in (_ARMED, _BOOT, _BOOT_TO_END, _ARMED_TO_END)
        if not self._open[i]:
            return mode == _BOOT_TO_END or (mode == _BOOT and self._end_at[i] == math.inf)
        was_armed = commander.disarmed_why != ""
        if mode in (_BOOT_TO_END, _ARMED_TO_END) or not was_armed:
            return True
        self._end_at[i] = min(self._end_at[i], now + _TAIL_S)
        return now < self._end_at[i]

    def _switch(self, i: int) -> None:
        name = self._s.vehicles[i].commander.name
        if self._open[i]:
            self._pass_on(i)
            self._sink.end(name)
        else:
            self._sink.begin(name, self._header(i))
            self._keys[i], self._home[i], self._taken[i] = (), None, self._at
        self._open[i] = self._layout.is_logged[i] = not self._open[i]
        self._any = any(self._open)

    def _header(self, i: int) -> bytes:
        values = {name: float(self._s.params[name][i]) for name in self._s.params}
        name = {"arena_vehicle": self._s.vehicles[i].commander.name}
        return b"".join(
            (
                ulog.file_header(round(1e6 * self._now)),
                ulog.information({**INFO, **name}),
                self._definitions,
                self._parameters.all(values),
                ulog.subscriptions(TOPICS),
            )
        )

    def _record_changes(self, i: int, v: Vehicle, now: float) -> None:
        key = self._state.key(i)
        if key != self._keys[i]:
            self._keys[i] = key
            self._state.update(i, now)
            self._pass_on(i, b"".join(self._layout.state[topic][i].tobytes() for topic in STATE))
        if v.home_n is not None and (home := (v.home_n, v.home_yaw, v.origin)) != self._home[i]:
            self._home[i] = home
            self._record_home(i, v.home_n, v.home_yaw)

    def _record_offboard(self, now: float) -> None:
        """Record what the newest setpoints of programs contain, of each vehicle at most every 0.1 s."""
        offboard = self._s.vehicles[0].offboard
        received_at = array(offboard.received_at)
        for i in np.flatnonzero(received_at >= self._offboard_at + _OFFBOARD_PERIOD_S).tolist():
            if self._open[i]:
                self._offboard_at[i] = received_at[i]
                self._pass_on(i, _offboard_record(offboard.contents[i], now))

    def _record_parameters(self) -> None:
        """Record the parameters that have changed since the last call."""
        params = self._s.params
        self._params_version = params.version
        self._modes = params["SDLOG_MODE"].astype(int).tolist()
        for name in params:
            known, values = self._values.get(name), params[name]
            if known is not None:
                for i in np.flatnonzero(known != values).tolist():
                    if self._open[i]:
                        self._pass_on(i, self._parameters.value(name, float(values[i])))
            self._values[name] = values.copy()

    # -- on arrival ------------------------------------------------------------------------------------------

    def record_vision(self, rows: Sequence[int], poses: Array, now: float) -> None:
        """Record the new poses of external vision, of each vehicle at most every 0.03 s.

        rows: vehicles with a new pose
        poses: poses of all vehicles, see `VisionInput` (V, 11)
        now: time since boot [s]
        """
        for i in rows:
            if self._open[i] and now >= self._vision_at[i] + _VISION_PERIOD_S - 1e-6:
                self._vision_at[i] = now
                self._pass_on(i, _vision_record(poses[i].tolist(), now))

    def record_text(self, i: int, severity: int, text: str) -> None:
        """Record a text of vehicle i that is sent to the user as STATUSTEXT.

        severity: MAV_SEVERITY
        """
        if self._open[i]:
            self._pass_on(i, ulog.text(severity, round(1e6 * self._now), text))

    def _record_home(self, i: int, home_n: tuple[float, float, float], yaw: float) -> None:
        v, now_us = self._s.vehicles[i], round(1e6 * self._now)
        self._homes[i] += 1
        lat = lon = alt = math.nan
        if v.origin is not None:
            lat0, lon0, alt0, heading = v.origin
            lat, lon = (x * 1e-7 for x in global_position(home_n[0], home_n[1], heading, lat0, lon0, EARTH_M))
            alt = alt0 - home_n[2]
        has = v.origin is not None
        values = (now_us, lat, lon, alt, *home_n, yaw, self._homes[i], has, has, True, False)
        self._pass_on(i, _HOME.pack(values))

    def close(self) -> None:
        """End all logs before the process ends."""
        for i, is_open in enumerate(self._open):
            if is_open:
                self._switch(i)
        self._sink.close()


class _Packer:
    """Encoder of the ULog records of one topic: values of the fields -> bytes."""

    def __init__(self, topic: str) -> None:
        kind = ulog.record_type(FORMATS[topic])
        head = np.zeros(1, kind)
        ulog.set_record_head(head, TOPICS.index(topic))
        size = sum(np.dtype(each[1]).itemsize for each in ulog.RECORD_HEAD)
        self._head = head.tobytes()[:size]
        codes = [
            code * math.prod(kind[name].shape)
            for name in (kind.names or ())[len(ulog.RECORD_HEAD) :]
            for code in [_CODES[kind[name].base.str]]
        ]
        self._struct = struct.Struct("<" + "".join(codes))

    def pack(self, values: tuple[float, ...]) -> bytes:
        return self._head + self._struct.pack(*values)


_CODES = {"<u8": "Q", "<f8": "d", "<f4": "f", "<u4": "I", "<i4": "i", "|u1": "B", "|i1": "b"}
_VISION, _OFFBOARD, _HOME = map(
    _Packer, ("vehicle_visual_odometry", "offboard_control_mode", "home_position")
)


def _definitions() -> bytes:
    return b"".join(ulog.topic_format(topic, FORMATS[topic]) for topic in TOPICS)


def _vision_record(pose: list[float], now: float) -> bytes:
    """Return a log record of `vehicle_visual_odometry`, in NED, without velocity.

    pose: position [m] [NED], attitude wxyz, variances of position [m2] and heading [rad2] (11,)
    """
    now_us = round(1e6 * now)
    var_yaw, ned, unknown, quality = pose[10], 1, 0, 100
    variances = (*pose[7:10], var_yaw, var_yaw, var_yaw, *_NAN3)
    return _VISION.pack((now_us, now_us, *pose[:7], *_NAN3, *_NAN3, *variances, ned, unknown, 0, quality))


def _offboard_record(contents: int, now: float) -> bytes:
    """Return a log record of `offboard_control_mode`.

    contents: what the setpoint contains, see `OffboardSetpoints`
    """
    given = [bool(contents >> bit & 1) for bit in range(5)]
    return _OFFBOARD.pack((round(1e6 * now), *given, False, False))
