"""Log records of mode, arming, landing and failsafes, from the commander of each vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.setpoints import Level
from arena.autopilot.flight_modes import MANUAL_MODES, Mode
from arena.autopilot.ulog.quantities import Sources
from arena.autopilot.vehicle import Vehicle

Records = NDArray[np.void]
NAV_STATES = {
    Mode.MANUAL: 0,
    Mode.ALTCTL: 1,
    Mode.POSCTL: 2,
    Mode.MISSION: 3,
    Mode.HOLD: 4,
    Mode.RTL: 5,
    Mode.ACRO: 10,
    Mode.DESCEND: 12,
    Mode.TERMINATE: 13,
    Mode.OFFBOARD: 14,
    Mode.STABILIZED: 15,
    Mode.TAKEOFF: 17,
    Mode.LAND: 18,
}
"""Flight mode -> `vehicle_status.nav_state`."""
_AUTO = (Mode.MISSION, Mode.HOLD, Mode.RTL, Mode.TAKEOFF, Mode.LAND)
_AVAILABLE = sum(1 << NAV_STATES[mode] for mode in (*_AUTO, Mode.OFFBOARD, *MANUAL_MODES))
_GLOBAL = sum(1 << NAV_STATES[mode] for mode in (Mode.MISSION, Mode.RTL))
_LOCAL = sum(1 << NAV_STATES[mode] for mode in (*_AUTO, Mode.POSCTL))
_GESTURE, _COMMAND, _LANDED, _PREFLIGHT, _FAILURE = 1, 4, 7, 8, 11  # ARM_DISARM_REASON
_DISARMED_WHY = {
    "by stick gesture": _GESTURE,
    "by external command": _COMMAND,
    "by landing": _LANDED,
    "by auto preflight disarming": _PREFLIGHT,
    "by failsafe": _FAILURE,
}
_DISARMED, _SPOOLING, _READY, _RAMP, _FLYING = range(1, 6)  # TAKEOFF_STATE
_GCS_LOST_S = 2.5  # since the last heartbeat
_CONSTANTS: Mapping[str, Mapping[str, Any]] = {
    "vehicle_status": {
        "vehicle_type": 1,
        "component_id": 1,
        "power_input_valid": 1,
        "safety_off": 1,
        "valid_nav_states_mask": _AVAILABLE,
        "can_set_nav_states_mask": _AVAILABLE,
    },
    "failsafe_flags": {
        "mode_req_local_position": _LOCAL,
        "mode_req_local_alt": _LOCAL | 1 << NAV_STATES[Mode.ALTCTL],
        "mode_req_attitude": _AVAILABLE,
        "mode_req_angular_velocity": _AVAILABLE,
        "mode_req_global_position": _GLOBAL,
        "mode_req_mission": 1 << NAV_STATES[Mode.MISSION],
        "mode_req_home_position": 1 << NAV_STATES[Mode.RTL],
        "mode_req_offboard_signal": 1 << NAV_STATES[Mode.OFFBOARD],
    },
}


class FlightState:
    """Fills the log records of mode, arming, landing and failsafes of each vehicle.

    records: topic -> records of all vehicles (V,)
    """

    def __init__(self, sources: Sources, records: Mapping[str, Records]) -> None:
        self._s, self._records = sources, records
        count = len(sources.vehicles)
        self._mode_since, self._mode = [0.0] * count, [Mode.HOLD] * count
        self._took_off_at = [0.0] * count
        self._watched: list[tuple[object, ...]] = [()] * count
        self.begin(0.0)
        for topic, constants in _CONSTANTS.items():
            for name, value in constants.items():
                records[topic][name] = value

    def begin(self, now: float) -> list[int]:
        """Read the values of `key` that can change without a decision of the commander. Return the vehicles with a changed value.

        These values are of the land detector, the setpoint level and the ground station. now: time since boot [s]
        """
        land = self._s.land
        self._now, self._level = now, self._s.sp.level.tolist()
        self._landed, self._contact = land.landed.tolist(), land.contact.tolist()
        lost = [v.gcs_age(now) > _GCS_LOST_S for v in self._s.vehicles]
        before, self._watched = (
            self._watched,
            list(zip(self._landed, self._contact, self._level, lost, strict=True)),
        )
        return [i for i, watched in enumerate(self._watched) if watched != before[i]]

    def key(self, i: int) -> tuple[object, ...]:
        """Return the values of vehicle i, such as mode and arming, that are logged as soon as they change."""
        v = self._s.vehicles[i]
        c, s = v.commander, v.inputs
        return (
            c.mode,
            c.intended,
            c.armed,
            c.failsafe,
            c.took_off,
            v.ready_to_arm,
            self._landed[i],
            self._contact[i],
            s.flying,
            s.xy_valid,
            s.z_valid,
            s.aligned,
            s.fence != "",
            s.manual_control,
            s.global_ok,
            s.home_ok,
            s.mission_ok,
            v.gcs_age(self._now) > _GCS_LOST_S,
            s.offboard_age > v.commander_params.com_of_loss_t,
            self._battery_warning(v),
            self._level[i],
            self._takeoff_state(v),
        )

    def update(self, i: int, now: float) -> None:
        """Fill all log records of vehicle i, because a value that `key` returns has changed.

        now: time since boot [s]
        """
        v = self._s.vehicles[i]
        if v.commander.mode is not self._mode[i]:
            self._mode[i], self._mode_since[i] = v.commander.mode, now
        if not v.commander.took_off:
            self._took_off_at[i] = 0.0
        elif not self._took_off_at[i]:
            self._took_off_at[i] = now
        records = self._records
        for topic, values in (
            ("vehicle_status", self._status(v, now)),
            ("vehicle_control_mode", self._control_mode(v)),
            ("vehicle_land_detected", self._landing(v)),
            ("actuator_armed", self._arming(v)),
            ("failsafe_flags", self._failsafes(v, now)),
            ("takeoff_status", self._takeoff(v)),
        ):
            record = records[topic][i]
            record["timestamp"] = round(1e6 * now)
            for name, value in values.items():
                record[name] = value

    def _status(self, v: Vehicle, now: float) -> dict[str, Any]:
        c, i = v.commander, v.row
        return {
            "armed_time": round(1e6 * c.armed_since) if math.isfinite(c.armed_since) else 0,
            "takeoff_time": round(1e6 * self._took_off_at[i]),
            "nav_state_timestamp": round(1e6 * self._mode_since[i]),
            "nav_state_user_intention": NAV_STATES[c.intended],
            "nav_state": NAV_STATES[c.mode],
            "arming_state": 2 if c.armed else 1,
            "latest_arming_reason": _COMMAND if c.armed or c.disarmed_why else 0,
            "latest_disarming_reason": _DISARMED_WHY.get(c.disarmed_why, 0),
            "failsafe": c.failsafe != "",
            "gcs_connection_lost": v.gcs_age(now) > _GCS_LOST_S,
            "system_type": v.mav_type,
            "system_id": v.system_id,
            "pre_flight_checks_pass": v.ready_to_arm,
        }

    def _control_mode(self, v: Vehicle) -> dict[str, Any]:
        c, sp, i = v.commander, self._s.sp, v.row
        level, on = int(sp.level[i]), c.armed
        position = on and level == Level.POSITION
        follows = position and bool(np.isfinite(sp.p_n[i]).any())
        moves = position and bool(np.isfinite((*sp.p_n[i], *sp.v_n[i])).any())
        return {
            "flag_armed": on,
            "flag_multicopter_position_control_enabled": position,
            "flag_control_auto_enabled": c.mode in (*_AUTO, Mode.DESCEND),
            "flag_control_offboard_enabled": c.mode is Mode.OFFBOARD,
            "flag_control_position_enabled": follows,
            "flag_control_velocity_enabled": moves,
            "flag_control_altitude_enabled": follows,
            "flag_control_climb_rate_enabled": moves,
            "flag_control_acceleration_enabled": position,
            "flag_control_attitude_enabled": level >= Level.ATTITUDE,
            "flag_control_rates_enabled": level >= Level.RATE,
            "flag_control_allocation_enabled": c.mode is not Mode.TERMINATE,
            "flag_control_termination_enabled": c.mode is Mode.TERMINATE,
        }

    def _landing(self, v: Vehicle) -> dict[str, Any]:
        land, i = self._s.land, v.row
        return {
            "landed": land.landed[i],
            "maybe_landed": land.contact[i],
            "ground_contact": land.contact[i],
            "at_rest": land.at_rest[i],
        }

    def _arming(self, v: Vehicle) -> dict[str, Any]:
        c = v.commander
        return {
            "armed": c.armed,
            "ready_to_arm": v.ready_to_arm,
            "force_failsafe": c.mode is Mode.TERMINATE,
        }

    def _failsafes(self, v: Vehicle, now: float) -> dict[str, Any]:
        s, p = v.inputs, v.commander_params
        return {
            "attitude_invalid": not s.aligned,
            "local_altitude_invalid": not s.z_valid,
            "local_position_invalid": not s.xy_valid,
            "local_position_invalid_relaxed": not s.xy_valid,
            "local_velocity_invalid": not s.xy_valid,
            "global_position_invalid": not s.global_ok,
            "auto_mission_missing": not s.mission_ok,
            "offboard_control_signal_lost": s.offboard_age > p.com_of_loss_t,
            "home_position_invalid": not s.home_ok,
            "manual_control_signal_lost": not s.manual_control,
            "gcs_connection_lost": v.gcs_age(now) > _GCS_LOST_S,
            "battery_warning": self._battery_warning(v),
            "geofence_breached": s.fence != "",
            "fd_critical_failure": v.commander.mode is Mode.TERMINATE,
        }

    def _takeoff(self, v: Vehicle) -> dict[str, Any]:
        tilt_limit = math.radians(float(self._s.params["MPC_TILTMAX_AIR"][v.row]))
        tilt_max = float(self._s.cascade.position.tilt_max[v.row])
        return {"takeoff_state": self._takeoff_state(v), "tilt_limit": min(tilt_limit, tilt_max)}

    def _takeoff_state(self, v: Vehicle) -> int:
        takeoff, s = self._s.takeoff, v.inputs
        if not v.commander.armed:
            return _DISARMED
        if s.flying:
            return _FLYING
        if math.isfinite(takeoff.begun[v.row]):
            return _RAMP
        spooled = s.now - v.commander.armed_since >= self._s.params["COM_SPOOLUP_TIME"][v.row]
        return _READY if spooled else _SPOOLING

    def _battery_warning(self, v: Vehicle) -> int:
        left, p = v.inputs.battery, v.commander_params
        return (left <= p.bat_low_thr) + (left <= p.bat_crit_thr) + (left <= p.bat_emergen_thr)
