"""The built-in autopilots of all simulated vehicles, stepped together. No sockets, no clock.

Their behaviour as seen from outside is PX4's; docs/builtin-autopilot.md lists the differences. One step runs, in this order:
fusion of external vision, estimator, then every 0.02 s land detector, commanders and flight modes, then controllers, control
allocation and telemetry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.authority import CommandGate
from arena.autopilot.commander import Commander, Mode
from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams
from arena.autopilot.control.control_allocator import ControlAllocator
from arena.autopilot.control.controllers import Cascade, steps_per_period
from arena.autopilot.control.flight_tasks import FlightTask, stop_motors
from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.land_detector import LandDetector, TakeoffRamp, climb_requested
from arena.autopilot.estimation.vision_input import vision_batch
from arena.autopilot.mavlink.mavlink_interface import MavlinkInterface
from arena.autopilot.mavlink.telemetry_packer import TelemetryPacker
from arena.autopilot.mavlink.telemetry_state import TelemetryState
from arena.autopilot.navigation.auto_modes import AutoModes
from arena.autopilot.param_table import Params
from arena.autopilot.vehicle import Vehicle
from arena.vehicle_models import vehicle_model
from arena.wire.px4_mode import mode_words

Array = NDArray[np.float64]

_DECISION_PERIOD_S = 0.02
_REALIGN_PERIOD_S = 1.0  # between two attempts
_REPORTED_MODES = {mode: mode_words(mode.custom_mode) for mode in Mode}  # names as in the HEARTBEAT
_IDLE = 0.1  # motor command of an armed vehicle on the ground


class Autopilots:
    """Built-in autopilots of V vehicles with at most R rotors each.

    settings: settings of the world, with the list `vehicles`
    dt: sensor period [s]
    authority: refuse commands of senders that must not command a vehicle now (`arena.authority`). PX4 does not.
    armed: True for each armed vehicle (V,)
    motors: motor commands 0..1 (V, R)
    thrust: collective thrust 0..1 (V,)
    """

    def __init__(self, settings: Mapping[str, Any], dt: float, *, authority: bool = False) -> None:
        vehicles = settings["vehicles"]
        n = len(vehicles)
        self.dt, self.names = dt, [x["name"] for x in vehicles]
        self.params = Params(n)
        self._events: list[str] = []
        for i, vehicle in enumerate(vehicles):
            values = {
                **vehicle["profile"].get("params", {}),
                **vehicle.get("params", {}),
                "MAV_SYS_ID": vehicle["id"],
            }
            self._events += [f"{vehicle['name']}: {problem}" for problem in self.params.load(i, values)]
        self.est = Estimator(self.params, n, dt)
        self.cascade = Cascade(self.params, n, dt)
        self.sp = Setpoints(n)
        self.allocator = _allocator(vehicles)
        self.land = LandDetector(self.params, n)
        self.takeoff = TakeoffRamp(self.params, n)
        self._radio_on = [bool(x.get("sticks", False)) for x in vehicles]
        self.vehicles = [
            Vehicle(
                i,
                x["name"],
                x["id"],
                self.params,
                self.est,
                mav_type=_mav_type(x["profile"]),
                heading=math.radians(settings.get("heading_deg", 0.0)),
            )
            for i, x in enumerate(vehicles)
        ]
        self.gates = [CommandGate(x["name"], x["id"], simulated=True) for x in vehicles if authority]
        self.interfaces = [
            MavlinkInterface(v, self._read_telemetry, self.gates[i] if authority else None)
            for i, v in enumerate(self.vehicles)
        ]
        self._telemetry: TelemetryState | None = None
        self._packer = TelemetryPacker(self.est, self.sp, self.cascade, self.allocator.rows.shape[1])
        self.tasks = [FlightTask(i) for i in range(n)]
        self._decide_every = steps_per_period(_DECISION_PERIOD_S, dt)
        self._realign_every = self._decide_every * steps_per_period(
            _REALIGN_PERIOD_S, dt * self._decide_every
        )
        self.auto = AutoModes(self.params, self.est, n, dt * self._decide_every)
        self.armed = np.zeros(n, bool)
        self.motors = np.zeros((n, self.allocator.rows.shape[1]))
        self.thrust = np.zeros(n)
        self._armed_since = np.full(n, np.inf)
        self._up_from = np.full(n, np.inf)  # time from which the motors follow the controllers [s]
        self._idle_motors = np.zeros_like(self.motors)
        self._steps, self._now = 0, 0.0
        self._consumed_mah = np.zeros(n)
        self._dead_motors: list[tuple[int, int]] = []
        self._params_version = self.params.version

    # -- interface to the world ------------------------------------------------------------------------------

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """Process a MAVLink datagram that arrived on a link of a vehicle.

        link: name of the link, `router`, `vision` or `panic`
        """
        self.interfaces[vehicle].receive(link, data, self._now)

    def sticks(self, vehicle: int, on: bool) -> None:
        """Switch a vehicle's simulated radio control on (with centred sticks) or off."""
        self._radio_on[vehicle] = on

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
            self._decide(now)
        self._control(now)
        self._steps += 1
        return self.motors

    def transmit(self) -> list[tuple[int, str, bytes]]:
        """Return the datagrams to send after this step, as (index of the vehicle, name of the link, datagram)."""
        now = self._now
        self._telemetry = TelemetryState(
            now,
            self.est,
            self._sensors,
            thrust=self.thrust,
            motors=self.motors,
            consumed_mah=self._consumed_mah,
        )
        active = [x for x in self.interfaces if x.has_output(now)]
        due = [(x, link, messages) for x in active for link, messages in x.prepare(now)]
        if due and (last := self._read_telemetry()):
            for x, link, messages in due:
                x.send_telemetry(link, messages, *last)
        return [(x.vehicle.row, link, data) for x in active for link, data in x.take_datagrams()]

    def _read_telemetry(self) -> tuple[TelemetryState, TelemetryPacker] | None:
        """Return the state of the last step and the packer that writes it into MAVLink messages; None before the first step."""
        if self._telemetry is None:
            return None
        self._packer.begin(self._telemetry)
        return self._telemetry, self._packer

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Process a request of the supervisor (see `process_context`), such as to refuse arming."""
        for gate in self.gates:
            gate.on_request(request, self._now)

    def events(self) -> list[str]:
        """Return the lines for the event log, such as mode changes and failsafes, since the last call.

        Changes of authority are not among them, because the router reports them.
        """
        for gate in self.gates:
            gate.events()
        found, self._events = self._events, []
        return found

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
        samples = {v.row: v.vision for v in self.vehicles if v.vision is not None and not v.failures.vision}
        if samples:
            for row in samples:
                self.vehicles[row].vision = None
            batch = vision_batch(samples, self.params, self.est.q_nb)
            if batch is not None:
                self.est.fuse_vision(*batch, now)
        if self._steps % self._decide_every == min(1, self._decide_every - 1):
            failed = np.array([v.failures.baro for v in self.vehicles])
            self.est.fuse_baro(np.where(failed, np.nan, sensors["baro_alt_m"]), now)

    # -- decisions, every 0.02 s ------------------------------------------------------------------------------------

    def _decide(self, now: float) -> None:
        est, sp = self.est, self.sp
        self._consumed_mah += self._sensors["battery_current_a"] * (self.auto.dt / 3.6)
        climbing = climb_requested(sp, est, self.params) & self.armed
        sink = np.where(sp.has_level(Level.POSITION), self.cascade.position.v_sp_n[:, 2], np.nan)
        self.land.update(now, est, self.thrust, climbing, sink)
        self.takeoff.update(now, self._armed_since, self.land.landed, climbing)
        self._sense(now)
        offboard = np.array([v.commander.mode is Mode.OFFBOARD for v in self.vehicles])
        full = np.where(offboard, self.params["MPC_Z_VEL_MAX_UP"], self.params["MPC_TKO_SPEED"])
        for v in self.vehicles:
            self._decide_one(v)
        flying, begun = self.takeoff.flying, np.isfinite(self.takeoff.begun)
        self.cascade.position.speed_up[:] = self.takeoff.climb_rate_limit(now, full)
        self.cascade.position.tilt_max[:] = np.where(
            flying, np.inf, np.radians(self.params["MPC_TILTMAX_LND"])
        )
        self.cascade.reset(~(flying | begun))
        self.armed = np.array([v.commander.armed for v in self.vehicles])
        self._armed_since = np.array([v.commander.armed_since for v in self.vehicles])
        on = self.armed & ~sp.has_level(Level.NONE)
        # Armed on the ground without a setpoint to climb: the motors idle, whatever the controllers command.
        running = on & (flying | begun)
        self._up_from = np.where(running, self._armed_since + self.params["COM_SPOOLUP_TIME"], np.inf)
        self._idle_motors = np.where(on, _IDLE, 0.0)[:, None] * self.allocator.present
        # Poses are rejected in flight. An armed vehicle that stands on the ground may align with them again.
        est.at_rest = self.armed & ~running & self.land.at_rest

    def _sense(self, now: float) -> None:
        est = self.est
        tilt = np.arccos(np.clip(est.r_nb[:, 2, 2], -1, 1)).tolist()
        xy, z, yaw = est.xy_valid(now).tolist(), est.z_valid(now).tolist(), est.yaw_valid(now).tolist()
        landed, flying = self.land.landed.tolist(), self.takeoff.flying.tolist()
        battery, aligned = self._sensors["battery_remaining"].tolist(), est.aligned.tolist()
        rejected: list[bool] = np.any(est.test_ratio > 1.0, axis=1).tolist()
        if self._params_version != self.params.version:
            for v in self.vehicles:
                v.commander_params = CommanderParams.read(self.params, v.row)
            self._params_version = self.params.version
        for v in self.vehicles:
            i = v.row
            params = v.commander_params
            v.aligned = aligned[i]
            if self._radio_on[i]:
                v.manual_control.receive("radio", now)
            v.inputs = inputs = CommanderInputs(
                now=now,
                xy_valid=xy[i],
                z_valid=z[i],
                yaw_valid=yaw[i],
                landed=landed[i],
                flying=flying[i],
                tilt_rad=tilt[i],
                battery=0.0 if v.failures.battery else battery[i],
                offboard_age=now - v.offboard_setpoint_at,
                gcs_age=now - v.gcs_heartbeat_at,
                aligned=aligned[i],
                offboard_needs_position=v.offboard_needs_position,
                poses_rejected=rejected[i],
                manual_control=v.manual_control.is_available(
                    now, params.com_rc_in_mode, params.com_rc_loss_t
                ),
            )
            v.booted = True
            self.auto.check(v, inputs)
        self._dead_motors = [(v.row, k) for v in self.vehicles for k in v.failures.motors]

    def _decide_one(self, v: Vehicle) -> None:
        c, s, params = v.commander, v.inputs, v.commander_params
        was_armed = c.armed
        c.update(s, params)
        if was_armed and not c.armed:
            self._events.append(f"{c.name}: disarmed")
        v.ready_to_arm = c.armed or not c.arm_checks(s, params)
        if c.armed:
            self._fly(v, s)
        else:
            self._stay_disarmed(v, s)
        v.landed_state = _landed_state(c, s)
        if self.gates:
            self.gates[v.row].on_state(c.armed, _REPORTED_MODES[c.mode], s.now)

    def _stay_disarmed(self, v: Vehicle, s: CommanderInputs) -> None:
        """Clear the setpoint of a disarmed vehicle. If no home position is set and the position is valid, set home to the present position.

        A request to reboot, or an estimator that rejects poses, makes the estimator align again."""
        i = v.row
        self.sp.clear(i)
        self.tasks[i].mode = None
        self.auto.leave(v, armed=False)
        if v.home_n is None and s.xy_valid and v.origin:
            v.set_home_to_current_position()
        lost = self.est.aligned[i] and not (s.xy_valid and s.yaw_valid)
        if v.reboot_requested or (
            lost and self._steps % self._realign_every == 0 and self.est.test_ratio[i].max() > 1.0
        ):
            self.est.realign(np.array([i]))
            v.reboot_requested = False

    def _fly(self, v: Vehicle, s: CommanderInputs) -> None:
        """Write the setpoint for the current flight mode of an armed vehicle."""
        c, i, task = v.commander, v.row, self.tasks[v.row]
        if not self.armed[i]:
            v.set_home_to_current_position()
            task.mode = None
        if self.auto.is_flying(v):
            task.mode = None
            requested = self.auto.fly(v, s, self.sp)
            if requested is not None:
                c.request_mode(requested, s, v.commander_params)
            return
        self.auto.leave(v, armed=True)
        if c.mode is Mode.OFFBOARD:
            task.mode = None
            self._copy_offboard_setpoint(v)
        elif c.mode is Mode.TERMINATE:
            stop_motors(self.sp, i)
        else:
            if task.mode is not c.mode:
                task.enter(
                    c.mode,
                    self.est,
                    v.yaw(),
                    self.params,
                    landed=s.landed,
                    takeoff_d=v.takeoff_target_d,
                )
            ground_d = v.home_n[2] if v.home_n else 0.0
            task.fly(self.sp, self.est, self.params, landed=not s.flying, ground_d=ground_d)
            if c.mode is Mode.TAKEOFF and task.reached:
                c.request_mode(Mode.HOLD, s, v.commander_params)

    def _copy_offboard_setpoint(self, v: Vehicle) -> None:
        o, i, sp = v.offboard_setpoint, v.row, self.sp
        if o is None:
            return
        sp.set_position(i, p_n=o.p_n, v_n=o.v_n, a_n=o.a_n, yaw=o.yaw, yaw_rate=o.yaw_rate)
        sp.level[i], sp.q_nb[i], sp.omega_b[i], sp.thrust[i] = o.level, o.q_nb, o.omega_b, o.thrust
        sp.yaw_rate_ff[i] = o.yaw_rate if o.level is Level.ATTITUDE else 0.0

    # -- control, every step ---------------------------------------------------------------------------------

    def _control(self, now: float) -> None:
        torque, thrust = self.cascade.update(self.sp, self.est)
        up = now >= self._up_from
        self.thrust = np.where(up, thrust, 0.0)
        up = up[:, None]
        u, self.cascade.saturated[:] = self.allocator.allocate(torque * up, self.thrust)
        self.motors = np.where(up, u, self._idle_motors)
        for i, k in self._dead_motors:
            self.motors[i, k : k + 1] = 0.0


def _landed_state(c: Commander, s: CommanderInputs) -> int:
    """Return the vehicle's MAV_LANDED_STATE: 1 on the ground, 2 in the air, 3 taking off, 4 landing."""
    if s.landed or not c.armed:
        return 1
    if not s.flying:
        return 3
    return 4 if c.mode in (Mode.LAND, Mode.DESCEND) else 2


def _mav_type(profile: Any) -> int:
    return vehicle_model(profile).mav_type(len(profile["rotors"]))


def _allocator(vehicles: Any) -> ControlAllocator:
    profiles = [v["profile"] for v in vehicles]
    most = max((len(p["rotors"]) for p in profiles), default=4)
    rows, present = np.zeros((len(profiles), most, 3)), np.zeros((len(profiles), most), bool)
    for i, p in enumerate(profiles):
        count = len(p["rotors"])
        rows[i, :count], present[i, :count] = vehicle_model(p).allocation(p["rotors"]), True
    return ControlAllocator(rows, present)
