"""The built-in autopilot of every simulated vehicle of an arena, stepped together. No sockets, no clock.

It keeps PX4's contract as seen from outside and is not PX4: docs/builtin-autopilot.md says where they differ.
One step: vision heard -> estimator -> (every few steps) land detector, commanders, modes -> cascade -> mixer -> telemetry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.commander import Commander, Limits, Mode, Sensed
from arena.autopilot.control.control_allocator import Mixer, mixing_rows
from arena.autopilot.control.controllers import Cascade
from arena.autopilot.control.flight_tasks import Task, termination
from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.land_detector import LandDetector, TakeoffRamp, wants_up
from arena.autopilot.mavlink import telemetry_batch
from arena.autopilot.mavlink.mavlink_interface import Face
from arena.autopilot.mavlink.telemetry_state import Snapshot
from arena.autopilot.navigation.auto_modes import Auto
from arena.autopilot.param_table import Params
from arena.geometry import yaw_from_quat

Array = NDArray[np.float64]

_DECIDE_EVERY = 5  # steps between decisions: 50 Hz at 250 Hz
_IDLE = 0.1  # motor command of an armed vehicle that stands


class Autopilots:
    """settings: the `world` slice; dt: its sensor period [s]."""

    def __init__(self, settings: Mapping[str, Any], dt: float) -> None:
        vehicles = settings["vehicles"]
        v = len(vehicles)
        self.dt, self.names = dt, [x["name"] for x in vehicles]
        self.params = Params(v)
        self._events: list[str] = []
        for i, vehicle in enumerate(vehicles):
            values = {
                **vehicle["profile"].get("params", {}),
                **vehicle.get("params", {}),
                "MAV_SYS_ID": vehicle["id"],
            }
            self._events += [f"{vehicle['name']}: {words}" for words in self.params.load(i, values)]
        self.est = Estimator(self.params, v, dt)
        self.cascade = Cascade(self.params, v, dt)
        self.sp = Setpoints(v)
        self.mixer = _mixer(vehicles)
        self.land = LandDetector(self.params, v)
        self.takeoff = TakeoffRamp(self.params, v)
        self._radio_on = [bool(x.get("sticks", False)) for x in vehicles]
        self.faces = [Face(i, x["name"], x["id"], self.params) for i, x in enumerate(vehicles)]
        self.tasks = [Task(i) for i in range(v)]
        self.auto = Auto(self.params, self.est, self.faces, dt * _DECIDE_EVERY)
        self.armed = np.zeros(v, bool)
        self.motors = np.zeros((v, self.mixer.rows.shape[1]))
        self.thrust = np.zeros(v)
        self._armed_since = np.full(v, np.inf)
        self._up_from = np.full(v, np.inf)  # [s] when the motors follow the cascade
        self._standing_motors = np.zeros_like(self.motors)
        self._steps, self._now = 0, 0.0
        self._consumed_mah = np.zeros(v)
        self._dead_motors: list[tuple[int, int]] = []
        self._limits = [self._limits_of(i) for i in range(v)]
        self._limits_version = self.params.version

    # -- the world's side ----------------------------------------------------------------------------------------------

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """A datagram that arrived on a link (router, vision, panic) of a vehicle."""
        self.faces[vehicle].receive(link, data, self._now, self.est.q_nb[vehicle].tolist())

    def sticks(self, vehicle: int, on: bool) -> None:
        """A pilot's radio goes on or off, its sticks in the middle. The slice says how it begins."""
        self._radio_on[vehicle] = on

    def step(self, now: float, sensors: Mapping[str, Array]) -> Array:
        """One sensor period ends at now [s]. sensors: accel_b, gyro_b, mag_b (V, 3), baro_alt_m, battery_* (V,).

        -> motor commands 0..1 (V, R).
        """
        self._now = now
        self._sensors = sensors
        self.est.predict(sensors["accel_b"], sensors["gyro_b"])
        self._fuse(now, sensors)
        if self._steps % _DECIDE_EVERY == 0:
            self._decide(now)
        self._control(now)
        self._steps += 1
        return self.motors

    def transmit(self) -> list[tuple[int, str, bytes]]:
        """Everything to send after this step: (vehicle, link, datagram)."""
        now, s = (
            self._now,
            Snapshot(
                self._now,
                self.est,
                self.sp,
                self.cascade,
                self._sensors,
                thrust=self.thrust,
                motors=self.motors,
                consumed_mah=self._consumed_mah,
            ),
        )
        for face in self.faces:
            face.newest = s
        speaking = [face for face in self.faces if face.has_to_speak(now)]
        due = [(face, link, msgid) for face in speaking for link, msgid in face.speak(now)]
        payloads = telemetry_batch.payloads(((face, msgid) for face, _, msgid in due), s)
        for face, link, msgid in due:
            face.tell(link, msgid, s, payloads)
        return [(face.i, link, data) for face in speaking for link, data in face.take_out()]

    def events(self) -> list[str]:
        """Sentences since the last call."""
        found, self._events = self._events, []
        return found

    def stats(self) -> dict[str, Any]:
        """Per vehicle: mode, arming, what was heard and refused."""
        return {
            name: {
                "mode": f.commander.mode.words,
                "armed": f.commander.armed,
                "failsafe": f.commander.failsafe,
                "vision_rejected": int(self.est.rejected[f.i]),
                **f.counts,
                **f.garbled(),
            }
            for name, f in zip(self.names, self.faces, strict=True)
        }

    # -- estimator -----------------------------------------------------------------------------------------------------

    def _fuse(self, now: float, sensors: Mapping[str, Array]) -> None:
        heard = [f for f in self.faces if f.vision is not None and not f.failures.vision]
        if heard:
            samples = [f.vision for f in heard]
            idx = np.array([f.i for f in heard])
            p, q = np.array([s.p_n for s in samples if s]), np.array([s.q_nb for s in samples if s])
            var_p, var_yaw = (
                np.array([s.var_p for s in samples if s]),
                np.array([s.var_yaw for s in samples if s]),
            )
            for f in heard:
                f.vision = None
            self.est.fuse_vision(idx, p, q, var_p, var_yaw, now)
        if self._steps % _DECIDE_EVERY == 1:
            broken = np.array([f.failures.baro for f in self.faces])
            self.est.fuse_baro(np.where(broken, np.nan, sensors["baro_alt_m"]), now)

    # -- decisions, 50 Hz ----------------------------------------------------------------------------------------------

    def _decide(self, now: float) -> None:
        est, sp = self.est, self.sp
        self._consumed_mah += self._sensors["battery_current_a"] * (self.dt * _DECIDE_EVERY / 3.6)
        up = wants_up(sp, est, self.params) & self.armed
        sink = np.where(sp.at(Level.POSITION), self.cascade.position.v_sp_n[:, 2], np.nan)
        self.land.update(now, est, self.thrust, up, sink)
        self.takeoff.update(now, self._armed_since, self.land.landed, up)
        self._sense(now)
        offboard = np.array([f.commander.mode is Mode.OFFBOARD for f in self.faces])
        full = np.where(offboard, self.params["MPC_Z_VEL_MAX_UP"], self.params["MPC_TKO_SPEED"])
        for face in self.faces:
            self._decide_one(face)
        flying, begun = self.takeoff.flying, np.isfinite(self.takeoff.begun)
        self.cascade.position.speed_up = self.takeoff.speed_up(now, full)
        self.cascade.position.tilt_max = np.where(flying, np.inf, np.radians(self.params["MPC_TILTMAX_LND"]))
        self.cascade.reset(~(flying | begun))
        self.armed = np.array([f.commander.armed for f in self.faces])
        self._armed_since = np.array([f.commander.armed_since for f in self.faces])
        on = self.armed & ~sp.at(Level.NONE)
        # Armed on the ground with nothing to climb for: idle, whatever the cascade says.
        climbs = on & (flying | begun)
        self._up_from = np.where(climbs, self._armed_since + self.params["COM_SPOOLUP_TIME"], np.inf)
        self._standing_motors = np.where(on, _IDLE, 0.0)[:, None] * self.mixer.present

    def _sense(self, now: float) -> None:
        est = self.est
        tilt = np.arccos(np.clip(est.r_nb[:, 2, 2], -1, 1)).tolist()
        xy, z, yaw = est.xy_valid(now).tolist(), est.z_valid(now).tolist(), est.yaw_valid(now).tolist()
        landed, flying = self.land.landed.tolist(), self.takeoff.flying.tolist()
        battery, aligned = self._sensors["battery_remaining"].tolist(), est.aligned.tolist()
        rejected: list[bool] = np.any(est.test_ratio > 1.0, axis=1).tolist()
        if self._limits_version != self.params.version:
            self._limits = [self._limits_of(i) for i in range(len(self.faces))]
            self._limits_version = self.params.version
        for f in self.faces:
            i = f.i
            f.aligned = aligned[i]
            f.limits = limits = self._limits[i]
            if self._radio_on[i]:
                f.sticks.hear("radio", now)
            f.sensed = Sensed(
                now=now,
                xy_valid=xy[i],
                z_valid=z[i],
                yaw_valid=yaw[i],
                landed=landed[i],
                flying=flying[i],
                tilt_rad=tilt[i],
                battery=battery[i],
                offboard_age=now - f.setpoint_at,
                gcs_age=f.gcs_age(now),
                aligned=aligned[i],
                offboard_needs_position=f.setpoint is not None and f.setpoint.needs_position,
                poses_rejected=rejected[i],
                sticks=f.sticks.there(now, limits.com_rc_in_mode, limits.com_rc_loss_t),
            )
            if f.failures.battery:
                f.sensed.battery = 0.0
            self.auto.sense(f, f.sensed)
        self._dead_motors = [(f.i, k) for f in self.faces for k in f.failures.motors]

    def _decide_one(self, f: Face) -> None:
        c, s, limits = f.commander, f.sensed, f.limits
        assert s is not None and limits is not None
        was_armed = c.armed
        c.update(s, limits)
        if was_armed and not c.armed:
            self._events.append(f"{c.name}: disarmed")
        f.ready_to_arm = c.armed or not c.arm_checks(s, limits)
        if c.armed:
            self._fly(f, s)
        else:
            self._stand(f)
        f.landed_state = _landed_state(c, s)

    def _stand(self, f: Face) -> None:
        """Disarmed: nothing to fly; a wrong estimate may start anew."""
        self.sp.clear(f.i)
        self.tasks[f.i].mode = None
        self.auto.rest(f, armed=False)
        if f.home_n is None and f.sensed and f.sensed.xy_valid and f.origin:
            f.home_n, f.home_yaw = self.est.p_n[f.i].tolist(), self._yaw(f.i)
        lost = self.est.aligned[f.i] and f.sensed and not (f.sensed.xy_valid and f.sensed.yaw_valid)
        if f.reboot_asked or (lost and self._steps % 250 == 0 and self.est.test_ratio[f.i].max() > 1.0):
            self.est.realign(np.array([f.i]))
            f.reboot_asked = False

    def _fly(self, f: Face, s: Sensed) -> None:
        """Write this vehicle's setpoint for its mode."""
        c, i, task = f.commander, f.i, self.tasks[f.i]
        if not self.armed[i]:
            f.home_n, f.home_yaw = self.est.p_n[i].tolist(), self._yaw(i)
            task.mode = None
        if self.auto.flies(f):
            task.mode = None
            asked = self.auto.fly(f, s, self.sp)
            if asked is not None:
                c.request_mode(asked, s, f.limits or self._limits[i])
            return
        self.auto.rest(f, armed=True)
        if c.mode is Mode.OFFBOARD:
            task.mode = None
            self._offboard(f)
        elif c.mode is Mode.TERMINATE:
            termination(self.sp, i)
        else:
            if task.mode is not c.mode:
                yaw = float(self._yaw(i))
                task.enter(c.mode, self.est, yaw, self.params, landed=s.landed, takeoff_d=f.takeoff_d)
            task.fly(self.sp, self.est, self.params, landed=not s.flying)
            if c.mode is Mode.TAKEOFF and task.reached:
                c.request_mode(Mode.HOLD, s, f.limits or self._limits[i])

    def _yaw(self, i: int) -> float:
        return float(yaw_from_quat(self.est.q_nb[i]))

    def _offboard(self, f: Face) -> None:
        o, i, sp = f.setpoint, f.i, self.sp
        if o is None:
            return
        sp.fly(i, p_n=o.p_n, v_n=o.v_n, a_n=o.a_n, yaw=o.yaw, yaw_rate=o.yaw_rate)
        sp.level[i], sp.q_nb[i], sp.omega_b[i], sp.thrust[i] = o.level, o.q_nb, o.omega_b, o.thrust
        sp.yaw_rate_ff[i] = o.yaw_rate if o.level is Level.ATTITUDE else 0.0

    def _limits_of(self, i: int) -> Limits:
        p = self.params

        def get(name: str) -> float:
            return float(p[name][i])

        return Limits(
            com_of_loss_t=get("COM_OF_LOSS_T"),
            com_obl_rc_act=int(get("COM_OBL_RC_ACT")),
            com_fail_act_t=get("COM_FAIL_ACT_T"),
            com_disarm_land=get("COM_DISARM_LAND"),
            com_disarm_prflt=get("COM_DISARM_PRFLT"),
            com_low_bat_act=int(get("COM_LOW_BAT_ACT")),
            bat_low_thr=get("BAT_LOW_THR"),
            bat_crit_thr=get("BAT_CRIT_THR"),
            bat_emergen_thr=get("BAT_EMERGEN_THR"),
            nav_dll_act=int(get("NAV_DLL_ACT")),
            com_dl_loss_t=get("COM_DL_LOSS_T"),
            cbrk_flightterm=int(get("CBRK_FLIGHTTERM")),
            fd_fail_s=get("FD_FAIL_R_TTRI"),
            fd_fail_rad=min(
                [math.radians(get(n)) for n in ("FD_FAIL_R", "FD_FAIL_P") if get(n) > 0], default=math.inf
            ),
            gf_action=int(get("GF_ACTION")),
            com_dll_except=int(get("COM_DLL_EXCEPT")),
            nav_rcl_act=int(get("NAV_RCL_ACT")),
            com_rcl_except=int(get("COM_RCL_EXCEPT")),
            com_rc_in_mode=int(get("COM_RC_IN_MODE")),
            com_rc_loss_t=get("COM_RC_LOSS_T"),
        )

    # -- control, every step -------------------------------------------------------------------------------------------

    def _control(self, now: float) -> None:
        torque, thrust = self.cascade.update(self.sp, self.est)
        up = now >= self._up_from
        self.thrust = np.where(up, thrust, 0.0)
        up = up[:, None]
        u, self.cascade.saturated = self.mixer.mix(torque * up, self.thrust)
        self.motors = np.where(up, u, self._standing_motors)
        for i, k in self._dead_motors:
            self.motors[i, k : k + 1] = 0.0


def _landed_state(c: Commander, s: Sensed) -> int:
    """MAV_LANDED_STATE: 1 on the ground, 2 in the air, 3 taking off, 4 landing."""
    if s.landed or not c.armed:
        return 1
    if not s.flying:
        return 3
    return 4 if c.mode in (Mode.LAND, Mode.DESCEND) else 2


def _mixer(vehicles: Any) -> Mixer:
    rotors = [v["profile"]["rotors"] for v in vehicles]
    most = max((len(r) for r in rotors), default=4)
    rows, present = np.zeros((len(rotors), most, 3)), np.zeros((len(rotors), most), bool)
    for i, r in enumerate(rotors):
        rows[i, : len(r)], present[i, : len(r)] = mixing_rows(r), True
    return Mixer(rows, present)
