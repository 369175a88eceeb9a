"""The built-in autopilots of all simulated vehicles, stepped together. No sockets, no clock.

Their behaviour as seen from outside is PX4's; docs/builtin-autopilot.md lists the differences. One step runs, in this order:
fusion of external vision, estimator, then every 0.02 s land detector, commanders and flight modes, then controllers, control
allocation and telemetry.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Concatenate, ParamSpec

import numpy as np
from numpy.typing import NDArray

from arena.authority import CommandGate, Role, role_on_link
from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams
from arena.autopilot.control.control_allocator import ControlAllocator
from arena.autopilot.control.controllers import Cascade, steps_per_period
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.land_detector import ClimbDetector, LandDetector, TakeoffRamp
from arena.autopilot.flight_modes import Mode
from arena.autopilot.make_vehicles import load_params, make_vehicles
from arena.autopilot.mavlink.mavlink_interface import MavlinkInterface
from arena.autopilot.mavlink.streams import LINK_RATES
from arena.autopilot.mavlink.telemetry import Telemetry
from arena.autopilot.mavlink.telemetry_packer import TelemetryPacker
from arena.autopilot.mavlink.telemetry_state import TelemetryState
from arena.autopilot.mode_flight import ModeFlight
from arena.autopilot.steady_flights import SteadyFlights
from arena.autopilot.stored_logs import LogLibrary
from arena.autopilot.ulog.recorder import Sink, UlogRecorder
from arena.autopilot.vehicle import Vehicle
from arena.kernels.arrays import array, integers, view
from arena.kernels.motor_outputs import MotorOutputs
from arena.kernels.motor_release import MotorRelease
from arena.kernels.offboard_setpoints import OffboardSetpoints
from arena.kernels.ordinary_messages import OrdinaryMessages
from arena.wire.mavlink_frame import SEEDS
from arena.wire.px4_mode import mode_words

Array = NDArray[np.float64]
_P = ParamSpec("_P")
_Write = Callable[Concatenate[UlogRecorder, _P], None]

_DECISION_PERIOD_S = 0.02
_REALIGN_PERIOD_S = 1.0  # between two attempts
_REPORTED_MODES = {mode: mode_words(mode.custom_mode) for mode in Mode}  # names as in the HEARTBEAT
REPEATABLE_BOOT_UNIX_US = (
    1_767_225_600_000_000  # 1 January 2026, fixed so that repeated flights send equal messages
)


class Autopilots:
    """Built-in autopilots of V vehicles with at most R rotors each.

    settings: settings of the world, with the list `vehicles`. `boot_unix_us`: Unix time of the boot [us], default
        REPEATABLE_BOOT_UNIX_US
    dt: sensor period [s]
    authority: refuse commands of senders that must not command a vehicle now (`arena.authority`). PX4 does not.
    ulog: receives the bytes of the vehicles' logs; None if no logs are made
    library: the stored logs, which clients can download
    armed: True for each armed vehicle (V,)
    motors: motor commands 0..1 (V, R)
    thrust: collective thrust 0..1 (V,)
    consumed_mah: consumed charge [mAh] (V,)
    """

    def __init__(
        self,
        settings: Mapping[str, Any],
        dt: float,
        *,
        authority: bool = False,
        ulog: Sink | None = None,
        library: LogLibrary | None = None,
    ) -> None:
        vehicles = settings["vehicles"]
        n = len(vehicles)
        self.dt, self.names = dt, [x["name"] for x in vehicles]
        self.params, self._events = load_params(vehicles)
        self.est = Estimator(self.params, n, dt)
        self.cascade = Cascade(self.params, n, dt)
        self.sp = Setpoints(n)
        offboard = self.sp.offboard_setpoints(self.est.q_nb)
        self.allocator = ControlAllocator.of([x["profile"] for x in vehicles])
        self.land = LandDetector(self.params, n)
        self.takeoff = TakeoffRamp(self.params, n)
        self.est.vision_input.read_flights_from(self.takeoff.flying)
        self._climb = ClimbDetector(self.params, self.sp, self.est, self.cascade.position.v_sp_n)
        self._radio_on = [bool(x.get("sticks", False)) for x in vehicles]
        self.vehicles = make_vehicles(settings, self.params, self.est, offboard)
        self._boot_unix_us = int(settings.get("boot_unix_us", REPEATABLE_BOOT_UNIX_US))
        self.gates = [CommandGate(x["name"], x["id"], simulated=True) for x in vehicles if authority]
        self._outputs = outputs = MotorOutputs(
            self.est.law, self.cascade.law, self.allocator.law, self.allocator.rows.shape[1]
        )
        self.motors, self.thrust = array(outputs.motors), array(outputs.thrust)
        self._ordinary = _ordinary_messages(self.vehicles, self.est, offboard, self.gates)
        self.consumed_mah = np.zeros(n)
        packer = TelemetryPacker(
            self.est,
            self.sp,
            self.cascade,
            self.thrust,
            self.motors,
            self.consumed_mah,
            links=n * len(LINK_RATES),
            boot_unix_us=self._boot_unix_us,
        )
        self._telemetry = Telemetry(self.vehicles, packer, self._read_state)
        self.interfaces = [
            MavlinkInterface(
                v,
                self._telemetry,
                self._ordinary,
                self.gates[i] if authority else None,
                partial(self._record_text, i),
                library,
                self._boot_unix_us * 1e-6,
            )
            for i, v in enumerate(self.vehicles)
        ]
        self._sensors: Mapping[str, Array] = {}  # {} before the first step
        self._decide_every = steps_per_period(_DECISION_PERIOD_S, dt)
        self._realign_every = self._decide_every * steps_per_period(
            _REALIGN_PERIOD_S, dt * self._decide_every
        )
        self.flight = ModeFlight(
            self.params, self.est, self.sp, self.cascade.position, n, dt * self._decide_every
        )
        for v in self.vehicles:
            v.is_inside_fence = partial(self.flight.auto.is_inside_fence, v)
        self._steady = SteadyFlights(self.est, offboard, self.land.landed, self.takeoff.flying)
        self.armed, self._in_offboard = np.zeros(n, bool), np.zeros(n, bool)
        self._armed_since = np.full(n, np.inf)
        self._release = MotorRelease(
            outputs,
            self.takeoff.law,
            integers(self.sp.level),
            self.armed,
            view(self._armed_since),
            self.land.at_rest,
            self.est.at_rest,
        )
        self._read_params()
        self._steps, self._now = 0, 0.0
        self._dead_motors: list[tuple[int, int]] = []
        self._tested: list[Vehicle] = []
        self._ulog_sink, self._ulog = ulog, UlogRecorder(self, ulog) if ulog is not None else None

    def _read_params(self) -> None:
        for v in self.vehicles:
            v.commander_params = CommanderParams.read(self.params, v.row)
        array(self._release.spoolup_s)[:] = self.params["COM_SPOOLUP_TIME"]
        array(self._release.tilt_landed)[:] = np.radians(self.params["MPC_TILTMAX_LND"])
        self._params_version = self.params.version

    # -- interface to the world ------------------------------------------------------------------------------

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """Process a MAVLink datagram that arrived on a link of a vehicle.

        link: name of the link, `router`, `vision`, `panic` or `ground`
        """
        if not self._ordinary.receive(vehicle, link, data, self._now):
            self._steady.wake(vehicle)
            self.interfaces[vehicle].receive(link, data, self._now)

    def sticks(self, vehicle: int, on: bool) -> None:
        """Switch a vehicle's simulated radio control on (with centred sticks) or off."""
        self._radio_on[vehicle] = on
        self._steady.wake(vehicle)

    def step(self, now: float, sensors: Mapping[str, Array]) -> Array:
        """Advance all autopilots by one sensor period; return the motor commands 0..1 (V, R).

        now: time at the end of the period [s]
        sensors: accel_b [m/s2], gyro_b [rad/s], mag_b [gauss] [FRD] (V, 3); baro_alt_m [m], battery_v [V],
            battery_current_a [A], battery_remaining 0..1 (V,)
        """
        self._now = now
        self._sensors = sensors
        self.est.predict(sensors["accel_b"], sensors["gyro_b"])
        self._fuse(now, sensors)
        if self._steps % self._decide_every == 0:
            self._log(UlogRecorder.decide, now, self._decide(now))
        self._control(now)
        self._log(UlogRecorder.step, now, sensors)
        self._steps += 1
        return self.motors

    def transmit(self) -> list[tuple[int, str, bytes]]:
        """Return the datagrams to send after this step, as (index of the vehicle, name of the link, datagram)."""
        now = self._now
        if not self._sensors or not self._telemetry.has_output(now):
            return []
        sent, state = [], None
        for row, link, datagram in self._telemetry.send_streams(now, self._sensors):
            if datagram:
                sent.append((row, link, datagram))
            elif (state := state or self._read_state()) is not None:
                sent += [(row, name, each) for name, each in self.interfaces[row].transmit(now, state)]
        return sent

    def _read_state(self) -> TelemetryState | None:
        """Return the newest state of all vehicles, for telemetry.

        Return None before the first step.
        """
        if not self._sensors:
            return None
        return TelemetryState(
            self._now,
            self.est,
            self._sensors,
            motors=self.motors,
            sp=self.sp,
        )

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Process a request of the supervisor, for example to refuse arming from now on.

        request: see `process_context`
        """
        self._steady.wake_all()
        for gate in self.gates:
            gate.on_request(request, self._now)

    def events(self) -> list[str]:
        """Return the lines for the event log since the last call, for example about mode changes and failsafes.

        Changes of authority are not among them, because the router reports them.
        """
        for gate in self.gates:
            if gate.has_news:
                gate.events()
        found, self._events = self._events + (self._ulog_sink.events() if self._ulog_sink else []), []
        return found

    def close(self) -> None:
        """Close the ULog files before the process ends."""
        self._log(UlogRecorder.close)

    def _log(self, write: _Write[_P], *args: _P.args, **named: _P.kwargs) -> None:
        """Call a method of the ULog recorder with arguments. An error ends the logging, but not the flight."""
        try:
            if self._ulog is not None:
                write(self._ulog, *args, **named)
        except Exception as error:
            self._ulog = None
            self._steady.wake_all()
            for v in self.vehicles:
                v.is_logged = False
            self._events.append(f"ulog: the logs of all vehicles end here, because of an error: {error!r}")

    def _record_text(self, row: int, severity: int, text: str) -> None:
        self._log(UlogRecorder.record_text, row, severity, text)

    def stats(self) -> dict[str, Any]:
        """Return flight mode, arming state and counts of received and refused messages, by vehicle name."""
        return {
            name: {
                "mode": v.commander.mode.label,
                "armed": v.commander.armed,
                "failsafe": v.commander.failsafe,
                "vision_rejected": int(self.est.rejected[v.row]),
                "blocked": x.gate.authority.blocked if x.gate is not None else "",
                **x.received_counts(),
            }
            for name, v, x in zip(self.names, self.vehicles, self.interfaces, strict=True)
        }

    # -- estimator -------------------------------------------------------------------------------------------

    def _fuse(self, now: float, sensors: Mapping[str, Array]) -> None:
        vision = self.est.vision_input
        if self._ulog is not None and (rows := vision.waiting_rows()):
            self._log(UlogRecorder.record_vision, rows, array(vision.pose), now)
        self.est.fuse_vision(now)
        if self._steps % self._decide_every == min(1, self._decide_every - 1):
            self.est.fuse_baro(sensors["baro_alt_m"], now)

    # -- decisions, every 0.02 s ------------------------------------------------------------------------------------

    def _decide(self, now: float) -> list[int]:  # rows of the vehicles that have decided
        self.consumed_mah += self._sensors["battery_current_a"] * (self.flight.dt / 3.6)
        self._climb.update(self.armed)
        climbing = self._climb.climbing
        self.land.update(now, self.est, self.thrust, climbing, self._climb.sink)
        self.takeoff.update(now, self._armed_since, self.land.landed, climbing)
        if self._params_version != self.params.version:
            self._read_params()
        masks = self.est.valid(now)
        if rows := self._steady.rows_to_decide(now, self._sensors["battery_remaining"]):
            deciding = [self.vehicles[i] for i in rows]
            self._in_offboard[rows] = [v.commander.mode is Mode.OFFBOARD for v in deciding]
            self._sense(now, masks, deciding)
            for v in deciding:
                self._decide_one(v)
                self._telemetry.update(v)
                self.interfaces[v.row].wake_if_changed()
                self._steady.update(v, now)
            self.armed[rows] = [v.commander.armed for v in deciding]
            self._armed_since[rows] = [v.commander.armed_since for v in deciding]
        self.cascade.position.speed_up[:] = self.takeoff.climb_rate_limit(now, self._in_offboard)
        self._release.update()
        return rows

    def _sense(self, now: float, masks: Sequence[NDArray[np.bool_]], deciding: Sequence[Vehicle]) -> None:
        """Copy the measured state of the vehicles to the inputs of their commanders.

        now: time since boot [s]
        masks: whether the horizontal position, the height and the heading are valid (V,)
        deciding: vehicles that decide in this step
        """
        est = self.est
        xy, z, yaw = (mask.tolist() for mask in masks)
        tilt, rejected = est.tilt.tolist(), est.pose_rejected.tolist()
        landed, flying = self.land.landed.tolist(), self.takeoff.flying.tolist()
        battery, aligned = self._sensors["battery_remaining"].tolist(), est.aligned.tolist()
        for v in deciding:
            i = v.row
            params = v.commander_params
            v.aligned = aligned[i]
            if self._radio_on[i]:
                v.manual_control.receive("radio", now)
            s = v.inputs
            s.now, s.tilt_rad, s.aligned = now, tilt[i], aligned[i]
            s.xy_valid, s.z_valid, s.yaw_valid = xy[i], z[i], yaw[i]
            s.landed, s.flying, s.poses_rejected = landed[i], flying[i], rejected[i]
            s.battery = 0.0 if v.failures.battery else battery[i]
            s.offboard_age, s.gcs_age = now - v.offboard_setpoint_at, now - v.gcs_heartbeat_at
            s.offboard_needs_position = v.offboard_needs_position
            s.manual = v.manual_control.update(
                now, params.com_rc_in_mode, params.com_rc_loss_t, params.gesture_s
            )
            v.booted = True
            self.flight.auto.check(v, s)
        self._tested = [v for v in self.vehicles if v.actuator_tests and not v.commander.armed]
        self._dead_motors = [(v.row, k) for v in self.vehicles for k in v.failures.motors]

    def _decide_one(self, v: Vehicle) -> None:
        c, s, params = v.commander, v.inputs, v.commander_params
        was_armed = c.armed
        c.update(s, params)
        if was_armed and not c.armed:
            self._events.append(f"{c.name}: disarmed")
        v.ready_to_arm = c.armed or not c.arm_checks(s, params)
        if c.armed:
            self.flight.fly(v, s, newly_armed=not self.armed[v.row])
        else:
            self._stay_disarmed(v, s)
        v.update_landed_state()
        if self.gates:
            self.gates[v.row].on_state(c.armed, _REPORTED_MODES[c.mode], s.now)

    def _stay_disarmed(self, v: Vehicle, s: CommanderInputs) -> None:
        """Clear the setpoint of a disarmed vehicle, and set its home position if none is set.

        Home is set to the present position, which must be valid.

        A request to reboot, or an estimator that rejects poses, makes the estimator align again.
        """
        i = v.row
        self.flight.stop(v)
        if v.home_n is None and s.xy_valid and v.origin:
            v.set_home_to_current_position()
        lost = self.est.aligned[i] and not (s.xy_valid and s.yaw_valid)
        if v.reboot_requested or (
            lost and self._steps % self._realign_every == 0 and self.est.test_ratio[i].max() > 1.0
        ):
            self.est.realign(np.array([i]))
            v.reboot_requested = False

    # -- control, every step ---------------------------------------------------------------------------------

    def _control(self, now: float) -> None:
        self._outputs.step(now, self.cascade.begin(self.sp))
        for v in self._tested:
            v.actuator_tests.apply(self.motors[v.row], now)
        for i, k in self._dead_motors:
            self.motors[i, k : k + 1] = 0.0


def _ordinary_messages(
    vehicles: Sequence[Vehicle], est: Estimator, offboard: OffboardSetpoints, gates: Sequence[CommandGate]
) -> OrdinaryMessages:
    """Return the reader of ordinary poses and setpoints. gates: one for each vehicle, or none"""
    ids = [v.system_id for v in vehicles]
    return OrdinaryMessages(
        integers(np.array(ids, np.int64)),
        est.vision_input,
        offboard,
        SEEDS,
        [link for link in LINK_RATES if all(role_on_link(link, own, own) is Role.PROGRAM for own in ids)],
        [gate.authority.passes_program_setpoint for gate in gates],
    )
