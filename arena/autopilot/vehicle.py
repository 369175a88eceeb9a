"""State of one vehicle of the built-in autopilot, and the actions that clients request.

No MAVLink bytes, no sockets, no clock.

`Autopilots` updates the measured state of each vehicle and flies it. The package `mavlink` translates
messages into calls of the methods here, and reads the state for telemetry. The dynamic state (estimate,
setpoints, motors) is kept in arrays over all vehicles, outside this class.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from arena.autopilot.actuator_tests import ActuatorTests
from arena.autopilot.commander import CRITICAL, WARNING, Commander
from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.flight_modes import Mode
from arena.autopilot.injected_failures import InjectedFailures
from arena.autopilot.manual_control import ManualControl
from arena.autopilot.navigation.mission_items import Origin, local
from arena.autopilot.navigation.mission_store import MissionStore
from arena.autopilot.navigation.orbit import Orbit, OrbitRequest, orbit_of
from arena.autopilot.param_table import Params
from arena.geometry import yaw_from_quat
from arena.kernels.arrays import array, integers, view
from arena.kernels.offboard_setpoints import OffboardSetpoints

LANDED_STATE_ON_GROUND = 1  # MAV_LANDED_STATE
_LANDING_MODES = frozenset({Mode.LAND, Mode.DESCEND})
_NEVER = -1e9
_ORIGIN_ALTITUDE_M = (-12_000.0, 100_000.0)  # limits of PX4
_REPORT_EVERY_REFUSED = 100
_POSITION_OR_VELOCITY = 3  # bits of `OffboardSetpoints.contents`
Point = tuple[float, float, float]


class RepositionTarget(NamedTuple):
    """Target of MAV_CMD_DO_REPOSITION. NaN keeps the present value.

    lat, lon: latitude, longitude [deg]
    alt: altitude AMSL [m]
    yaw: heading [rad]
    """

    lat: float
    lon: float
    alt: float
    yaw: float


class Vehicle:
    """State of one vehicle (home, origin, newest setpoint), with a method for each request of a client.

    row: row of the vehicle in the arrays over all vehicles
    system_id: MAVLink system id (MAV_SYS_ID)
    mav_type: MAV_TYPE of the heartbeats
    rotors: number of rotors
    now: time of the datagram that is processed [s]
    booted: True after the commander has run once; before, commands are rejected
    inputs, commander_params: inputs of the commander's last run
    aligned, ready_to_arm, landed_state: results of the commander's last run; landed_state is a MAV_LANDED_STATE
    is_logged: True while a log of the vehicle is written
    took_off_at: time of the last take-off [s], NaN before the first
    flights: number of times the vehicle was armed by a client
    leg_target_n: point to which a mission, a return or a reposition flies now [m] [NED], None if there is none
    actuator_tests: motors that a client turns while the vehicle is disarmed
    vision_input: receives poses of external vision, of all vehicles
    offboard: newest offboard setpoints of all vehicles
    takeoff_target_d: height requested by NAV_TAKEOFF [m] [NED down], NaN for MIS_TAKEOFF_ALT
    origin: place and direction of the local frame on Earth, None if not set
    heading: direction of the local frame's north, clockwise from true north [rad]
    home_n, home_yaw: home position [m] [NED] (3,) and heading [rad]
    reposition_target: requested target to which the flight has not begun yet, None if there is none
    requested_speed: requested cruise speed [m/s]; NaN if none is requested, -1 for the default
    orbit: circle that the vehicle flies in HOLD, None if it flies none
    is_inside_fence: function that returns whether points [m] [NED] are inside the geofence
    gcs_heartbeat_at: time of the last ground station heartbeat on any link [s]
    counts: number of refused messages, by kind
    """

    def __init__(
        self,
        row: int,
        name: str,
        system_id: int,
        params: Params,
        estimator: Estimator,
        offboard: OffboardSetpoints,
        *,
        mav_type: int = 2,
        rotors: int = 4,
        heading: float = 0.0,
    ) -> None:
        self.mav_type, self.rotors, self.heading = mav_type, rotors, heading
        self.row, self.system_id, self.params, self._estimator = row, system_id, params, estimator
        self.commander = Commander(name)
        self.inputs = CommanderInputs()
        self.commander_params = CommanderParams.read(params, row)
        self.now = 0.0
        self.booted = False
        self.aligned = False
        self.ready_to_arm = False
        self.landed_state = LANDED_STATE_ON_GROUND
        self.is_logged = False
        self.took_off_at = math.nan
        self.flights = 0
        self.leg_target_n: Point | None = None
        self.actuator_tests = ActuatorTests()
        self.vision_input, self.offboard = estimator.vision_input, offboard
        self._offboard_at, self._offboard_contents = (
            view(array(offboard.received_at)),
            integers(np.asarray(offboard.contents)),
        )
        self.takeoff_target_d = math.nan
        self.origin: Origin | None = None
        self.home_n: Point | None = None
        self.home_yaw = 0.0
        self.missions = MissionStore()
        self.reposition_target: RepositionTarget | None = None
        self.requested_speed = math.nan
        self.orbit: Orbit | None = None
        self.is_inside_fence: Callable[[list[Point]], bool] = lambda points: True
        self.failures = InjectedFailures()
        self.manual_control = ManualControl()
        self.gcs_heartbeat_at = _NEVER
        self.reboot_requested = False
        self.counts: Counter[str] = Counter()

    # -- measured state --------------------------------------------------------------------------------------

    def q_nb(self) -> list[float]:
        """Return the estimated attitude [-] wxyz (4,)."""
        attitude: list[float] = self._estimator.q_nb[self.row].tolist()
        return attitude

    def update_landed_state(self) -> None:
        """Update the MAV_LANDED_STATE: 1 on the ground, 2 in the air, 3 taking off, 4 landing."""
        c, s, before = self.commander, self.inputs, self.landed_state
        if s.landed or not c.armed:
            self.landed_state = LANDED_STATE_ON_GROUND
        elif not s.flying:
            self.landed_state = 3
        else:
            self.landed_state = 4 if c.mode in _LANDING_MODES else 2
        if before == LANDED_STATE_ON_GROUND != self.landed_state:
            self.took_off_at = s.now

    def yaw(self) -> float:
        """Return the estimated heading [rad]."""
        return float(yaw_from_quat(self._estimator.q_nb[self.row]))

    def gcs_age(self, now: float) -> float:
        """Return the time since the last heartbeat of a ground station [s]."""
        return now - self.gcs_heartbeat_at

    def local_from_global(self, lat: float, lon: float, alt: float) -> Point | None:
        """Convert a global position to a local position [m] [NED]; None if no origin is set.

        lat, lon: latitude, longitude [deg]
        alt: altitude AMSL [m]
        """
        if self.origin is None:
            return None
        n, e = local(self.origin, lat, lon)
        return n, e, self.origin.alt - alt

    # -- commands --------------------------------------------------------------------------------------------

    def request_mode(self, mode: Mode | None) -> bool:
        """Change the flight mode. Return whether the request was accepted.

        Each request ends an orbit.
        """
        self._refresh_offboard()
        self.orbit = None
        return not self.commander.request_mode(mode, self.inputs, self.commander_params)

    def arm(self, why: str = "by external command") -> bool:
        """Arm the vehicle if every arming check passes. Return whether the vehicle is armed."""
        self._refresh_offboard()
        was_armed = self.commander.armed
        armed = not self.commander.arm(self.inputs, self.commander_params, why=why)
        if armed and not was_armed:
            self.flights += 1
            self.actuator_tests.stop()
        return armed

    def disarm(self, *, force: bool) -> bool:
        """Disarm the vehicle. Return whether the vehicle is disarmed.

        In the air this needs `force`.
        """
        return not self.commander.disarm(self.inputs, force=force)

    def terminate(self, why: str) -> None:
        """Stop the motors, even in flight."""
        self.commander.terminate(why)

    def _refresh_offboard(self) -> None:
        """Update the age of the newest offboard setpoint before a decision about mode or arming.

        Clients request OFFBOARD right after their first setpoint, before the next decision updates the age.
        """
        self.inputs.offboard_age = self.now - self.offboard_setpoint_at
        self.inputs.offboard_needs_position = self.offboard_needs_position

    def request_takeoff(self, altitude: float) -> bool:
        """Enter the mode TAKEOFF. Return whether the request was accepted.

        altitude: target altitude AMSL [m]; NaN or 0 for MIS_TAKEOFF_ALT
        """
        given = self.origin is not None and math.isfinite(altitude) and altitude != 0.0
        self.takeoff_target_d = self.origin.alt - altitude if self.origin and given else math.nan
        return self.request_mode(Mode.TAKEOFF)

    def request_reposition(self, target: RepositionTarget, speed: float) -> bool:
        """Fly to a target and hold there. Return whether the request was accepted.

        speed: cruise speed [m/s]; zero or a negative value keeps the present speed
        """
        accepted = self.request_mode(Mode.HOLD)
        if accepted and self.commander.armed:
            self.reposition_target = target
            self.requested_speed = speed if speed > 0 else self.requested_speed
        return accepted

    def request_orbit(self, request: OrbitRequest) -> bool:
        """Fly on a circle in the mode HOLD. Return whether the request was accepted."""
        here: list[float] = self._estimator.p_n[self.row].tolist()
        centre: Point = (here[0], here[1], here[2])
        has_place = math.isfinite(request.lat) and math.isfinite(request.lon)
        if self.origin is None and (has_place or math.isfinite(request.alt)):
            self.commander.report(CRITICAL, "Orbit rejected: no global origin")
            return False
        if has_place and self.origin is not None:
            centre = (*local(self.origin, request.lat, request.lon), centre[2])
        if math.isfinite(request.alt) and self.origin is not None:
            centre = (centre[0], centre[1], self.origin.alt - request.alt)
        orbit = orbit_of(
            request, centre, self.yaw(), float(self.params["MC_ORBIT_RAD_MAX"][self.row]), self.orbit
        )
        if orbit is None or not self.is_inside_fence(orbit.points()):
            what = "Orbit radius limit exceeded" if orbit is None else "Orbit is outside geofence"
            self.commander.report(CRITICAL, what)
            return False
        accepted = self.request_mode(Mode.HOLD)
        self.orbit = orbit if accepted and self.commander.armed else None
        return accepted

    def set_home_to_current_position(self) -> None:
        """Set home to the estimated position and heading.

        The caller checks that position and heading are valid.
        """
        north, east, down = self._estimator.p_n[self.row].tolist()
        self.home_n, self.home_yaw = (north, east, down), self.yaw()

    def set_home_here(self) -> bool:
        """Set home to the estimated position. Return False if the position or the origin is not valid."""
        known = self.origin is not None and self.inputs.xy_valid
        if known:
            self.set_home_to_current_position()
        return known

    def set_home_at(self, lat: float, lon: float, alt: float) -> bool:
        """Set home to a global position. Return False if no origin is set.

        lat, lon: latitude, longitude [deg]. alt: altitude AMSL [m]
        """
        point = self.local_from_global(lat, lon, alt)
        self.home_n = point or self.home_n
        return point is not None

    def set_origin(self, lat: float, lon: float, alt: float) -> None:
        """Set the origin of the local frame of a disarmed vehicle.

        Do nothing if the vehicle is armed or a value is out of range.

        lat, lon: latitude, longitude [deg]
        alt: altitude AMSL [m]
        """
        low, high = _ORIGIN_ALTITUDE_M
        if abs(lat) <= 90.0 and abs(lon) <= 180.0 and low < alt < high and not self.commander.armed:
            self.origin = Origin(lat, lon, alt, self.heading)

    def inject_failure(self, p: Sequence[float]) -> int:
        """Run MAV_CMD_INJECT_FAILURE and return its MAV_RESULT.

        p: FAILURE_UNIT, FAILURE_TYPE and instance
        """
        result = self.failures.inject(p, enabled=bool(self.params["SYS_FAILURE_EN"][self.row]))
        self.vision_input.failed[self.row] = self.failures.vision
        self._estimator.baro_failed[self.row] = self.failures.baro
        if result == 0:
            self.commander.report(
                WARNING, f"Failure injected: unit {p[0]:.0f}, type {p[1]:.0f}, instance {p[2]:.0f}"
            )
        return result

    # -- streams from outside --------------------------------------------------------------------------------

    @property
    def offboard_setpoint_at(self) -> float:
        """Time of the newest offboard setpoint [s]."""
        return self._offboard_at[self.row]

    @property
    def offboard_needs_position(self) -> bool:
        """True if the newest offboard setpoint contains a position or velocity, and so needs a valid position estimate."""
        return self._offboard_contents[self.row] & _POSITION_OR_VELOCITY != 0

    def refuse_offboard_setpoint(self, reason: str) -> None:
        """Count a refused offboard setpoint. Report the 1st, 101st, 201st ... refusal to the user.

        reason: reason of the refusal; "" is counted but not reported
        """
        self.counts["refused setpoint"] += 1
        if reason and self.counts["refused setpoint"] % _REPORT_EVERY_REFUSED == 1:
            self.commander.report(CRITICAL, f"Setpoint ignored: {reason}")

    def received_counts(self) -> Counter[str]:
        """Return the numbers of received poses and of refused messages, by kind."""
        accepted, refused, repeated = np.asarray(self.vision_input.counts)[self.row].tolist()
        poses = {"vision": accepted, "vision refused": refused, "vision repeated": repeated}
        return Counter(poses) + self.counts
