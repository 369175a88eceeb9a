"""Requirements -> PX4 parameters, with the names and units of one PX4 version. Pure.

Requirements that a version has no parameter for are listed in `Generated.not_possible`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.params.facts.failsafe_actions import Action, Event, actions, sticks, ways
from arena.params.facts.failsafe_delays import delays
from arena.params.facts.parameter_table import Parameter, Version, parameters
from arena.params.generation.requirements import Failsafe, Reaction, Requirements

_EMERGENCY = 0.7  # of the charge at which it lands
RETURN_SHARE = 0.6
"""Of the room's height, up to which AUTO.RTL climbs."""
VISION_NOISE_M, VISION_NOISE_RAD = 0.01, 0.05
"""Floors under the covariance that comes with each pose: PX4 takes no less."""

_EV_CTRL = 15  # position 1, height 2, velocity 4, yaw 8
_AID_MASK = 8 | 16  # vision position and yaw, up to 1.13
_VISION = 3  # EKF2_HGT_REF, EKF2_HGT_MODE
_WITHOUT_STICKS: Event = "offboard_loss_without_sticks"
_NO_COMPASS = 5  # EKF2_MAG_TYPE: heading comes with the poses
_EVERYWHERE = (
    7  # COM_RCL_EXCEPT: missions, hold and take-off, offboard; a landing and a return go on by themselves
)
_TAKEOFF_M = 2.5  # MIS_TAKEOFF_ALT
_RETURN = {"RTL_RETURN_ALT": 30.0, "RTL_DESCEND_ALT": 10.0}  # PX4's own heights [m], where the room is higher
# gains of velocity, which became accelerations with 1.11: then = now * hover / g
_VELOCITY_GAINS = {
    f"MPC_{axis}_VEL_{term}_ACC": f"MPC_{axis}_VEL_{term}" for axis in ("XY", "Z") for term in "PID"
}


class Line(NamedTuple):
    """One parameter.

    meaning: its effect here.
    reason: who asked for it: `arena.yaml:7`, `profile iris`, `arena's default`, ...
    """

    name: str
    value: float
    meaning: str
    reason: str


class Generated(NamedTuple):
    """The parameters of one vehicle.

    lines: one per parameter.
    not_possible: requirements that this version has no parameter for, a sentence each.
    """

    lines: tuple[Line, ...]
    not_possible: tuple[str, ...]

    @property
    def values(self) -> dict[str, float]:
        return {line.name: line.value for line in self.lines}


def generate(required: Requirements, version: Version | str) -> Generated:
    """Return the parameters that meet the requirements in this PX4 version.

    A later line replaces an earlier one of the same name; parameters that the user names come last.
    Raises InputError for a version that is not in the table.
    """
    version = Version.of(version)
    made = _Generator(required, version)
    for part in (made.vision, made.sensors, made.failsafes, made.fence, made.landing, made.vehicle, made.own):
        for line in part():
            made.lines[line.name] = line
    return Generated(tuple(made.lines.values()), tuple(made.not_possible))


class _Generator:
    def __init__(self, required: Requirements, version: Version) -> None:
        self.required, self.version = required, version
        self.known: Mapping[str, Parameter] = parameters(version)
        self.lines: dict[str, Line] = {}
        self.not_possible: list[str] = []

    def vision(self) -> Iterator[Line]:
        required, known = self.required, self.known
        if required.vision_delay_ms is None:
            return
        reason = self._reason("vision")
        if "EKF2_EV_CTRL" in known:
            yield Line("EKF2_EV_CTRL", _EV_CTRL, "poses are fused: position, height, velocity, yaw", reason)
            yield Line("EKF2_GPS_CTRL", 0, "no satellites are fused", reason)
        else:
            yield Line("EKF2_AID_MASK", _AID_MASK, "poses are fused: position and yaw; no satellites", reason)
        height = "EKF2_HGT_REF" if "EKF2_HGT_REF" in known else "EKF2_HGT_MODE"
        yield Line(height, _VISION, "height comes from the poses", reason)
        yield Line("EKF2_MAG_TYPE", _NO_COMPASS, "heading comes from the poses, not from a compass", reason)
        yield Line("EKF2_EVP_NOISE", VISION_NOISE_M, "least noise of a pose's position [m]", reason)
        yield Line("EKF2_EVA_NOISE", VISION_NOISE_RAD, "least noise of a pose's angles [rad]", reason)
        yield Line(
            "EKF2_EV_DELAY",
            required.vision_delay_ms,
            "age of a pose on arrival [ms]",
            self._reason("vision_delay_ms"),
        )

    def sensors(self) -> Iterator[Line]:
        required, known = self.required, self.known
        reason = self._reason("gps")
        if "SYS_HAS_GPS" in known:
            yield Line(
                "SYS_HAS_GPS",
                int(required.gps),
                "there are satellites" if required.gps else "there are no satellites here",
                reason,
            )
        elif not required.gps:
            yield Line("COM_ARM_WO_GPS", 1, "it may arm without satellites", reason)
        reason = self._reason("sticks")
        source = sticks("radio" if required.sticks else "none", self.version)
        yield Line(
            "COM_RC_IN_MODE",
            source,
            "sticks come by radio" if required.sticks else "there are no sticks",
            reason,
        )
        if required.sticks and required.channels:
            yield Line("RC_CHAN_CNT", required.channels, "channels of the radio", reason)
            for k, axis in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), 1):
                yield Line(f"RC_MAP_{axis}", k, f"{axis.lower()} stick", reason)

    def failsafes(self) -> Iterator[Line]:
        f, sticky = self.required.failsafe, self.required.sticks
        need, why = "offboard_loss", "setpoints stop"
        yield from self._react(need, _WITHOUT_STICKS, f.offboard_loss, why)
        if (
            "COM_OBL_ACT" in self.known
        ):  # which of the two 1.12 and 1.13 obey depends on COM_RCL_EXCEPT: both say the same
            yield from self._react(
                need, "offboard_loss", f.offboard_loss, f"{why}, with sticks", quiet=not sticky
            )
        may = "setpoints may be missing so long [s]"
        yield from self._after(need, "offboard_loss", "COM_OF_LOSS_T", f.offboard_loss_after_s, may)
        yield from self._position_loss(f)
        yield from self._battery(f)
        yield from self._react(
            "rc_loss",
            "sticks_loss_in_offboard",
            f.rc_loss if sticky else "none",
            "sticks are lost in OFFBOARD",
        )
        if sticky and f.rc_loss != "none":
            yield from self._react("rc_loss", "sticks_loss", f.rc_loss, "sticks are lost")
        if not sticky and f.rc_loss != "none":
            self.not_possible.append(
                f"failsafe.rc_loss: the vehicle has no sticks that could be lost; {f.rc_loss} is not set"
            )
        if sticky and f.rc_loss == "none":
            yield from self._react("rc_loss", "sticks_loss", "none", "sticks are lost", quiet=True)
            if "COM_RCL_EXCEPT" in self.known:
                yield Line(
                    "COM_RCL_EXCEPT",
                    _EVERYWHERE,
                    "none when sticks are lost",
                    self._reason("failsafe.rc_loss"),
                )
        yield from self._data_link_loss(f)
        yield from self._react("geofence", "geofence", f.geofence, "a geofence is crossed")
        yield from self._attitude(f)
        for name in ("COM_FAIL_ACT_T", "COM_RCL_ACT_T", "COM_BAT_ACT_T"):
            if name in self.known:
                yield Line(
                    name, 0.0, "failsafes act at once, without a hold before [s]", self._reason("failsafe")
                )

    def _data_link_loss(self, f: Failsafe) -> Iterator[Line]:
        action, when = f.data_link_loss, "no ground station is heard"
        if action == "terminate" and self.version.minor >= 14:
            self.not_possible.append(
                f"failsafe.data_link_loss: PX4 {self.version} misses the ground station while it boots and has heard none"
                " yet, and never takes a termination back: no flight could begin; terminate is not set, and disarm would do"
            )
            action = "none"
        yield from self._react("data_link_loss", "data_link_loss", action, when)
        if action != "none":
            need, may = "data_link_loss", "a ground station may be silent so long [s]"
            yield from self._react(need, "data_link_loss_in_offboard", action, when)
            yield from self._after(need, "data_link_loss", "COM_DL_LOSS_T", f.data_link_loss_after_s, may)

    def _position_loss(self, f: Failsafe) -> Iterator[Line]:
        if self.required.vision_delay_ms is None:
            return
        event: Event = "position_loss_in_offboard"
        may = "poses may be missing so long [us]"
        yield from self._after("position_loss", event, "EKF2_NOAID_TOUT", f.position_loss_after_s, may)
        if f.position_loss == "land":  # modes flown by sticks; 1.17 and newer go to altitude mode in any case
            yield from self._react(
                "position_loss", "position_loss_in_position_mode", "descend", "poses are lost", quiet=True
            )
        wanted: Action = "descend" if f.position_loss == "land" else f.position_loss
        falls_to = f.offboard_loss in (
            "land",
            "hold",
            "return",
        )  # these want a position, and become descend without one
        if wanted == "descend" and (falls_to or self.version.minor < 12):
            return
        way, asked_already = self._ways(event, wanted), self._ways(_WITHOUT_STICKS, f.offboard_loss)
        if not way or any(asked_already.get(name, value) != value for name, value in way.items()):
            self.not_possible.append(
                f"failsafe.position_loss: PX4 {self.version} has no answer of its own to lost poses in OFFBOARD: it gives that of"
                f" offboard_loss ({f.offboard_loss}), a blind descent where this wants a position; {f.position_loss} is not set"
            )

    def _battery(self, f: Failsafe) -> Iterator[Line]:
        reason = self._reason("failsafe.low_battery")
        action: Reaction = "warn" if f.low_battery_land is None else "land"
        yield from self._react("low_battery", "low_battery", action, "the battery is low")
        warns = self._held("BAT_LOW_THR", f.low_battery_warn, "failsafe.low_battery: warn")
        yield Line("BAT_LOW_THR", warns, "it warns at this charge", reason)
        if f.low_battery_land is not None:
            lands = self._held("BAT_CRIT_THR", f.low_battery_land, "failsafe.low_battery: land")
            known = self.known["BAT_EMERGEN_THR"]
            lowest = min(max(round(_EMERGENCY * lands, 3), known.min or 0.0), known.max or 1.0)
            yield Line("BAT_CRIT_THR", lands, "it lands at this charge", reason)
            yield Line("BAT_EMERGEN_THR", lowest, "emergency, which is answered with landing too", reason)

    def _attitude(self, f: Failsafe) -> Iterator[Line]:
        if f.attitude is None:
            return
        mild: Action = (
            "none" if "none" in actions("attitude_failure", self.version) else "warn"
        )  # a warning is all that is left
        yield from self._react(
            "attitude", "attitude_failure", mild if f.attitude == "none" else f.attitude, "it tilts too far"
        )
        for name in ("FD_FAIL_R", "FD_FAIL_P") if f.attitude != "none" else ():
            held = self._held(name, f.attitude_above_deg, f"failsafe.attitude: {f.attitude_above_deg:g} deg")
            yield Line(name, held, "its attitude has failed beyond [deg]", self._reason("failsafe.attitude"))

    def fence(self) -> Iterator[Line]:
        """A circle round home, rounded up so that the whole box is in it, and a height above home: no version has a box."""
        fence, reason = self.required.fence, self._reason("geofence")
        if fence is None:
            return
        if self.required.vision_delay_ms is None and not self.required.gps:
            self.not_possible.append(
                "geofence: without poses and satellites the vehicle has no home to measure from; no fence is set"
            )
            return
        across = math.ceil(fence.radius_m * 1e3 - 1e-6) / 1e3
        yield Line("GF_MAX_HOR_DIST", across, "from home to the fence's farthest corner [m]", reason)
        yield Line(
            "GF_MAX_VER_DIST", round(fence.height_m, 3), "from home to the fence's ceiling [m]", reason
        )
        if fence.height_m <= _TAKEOFF_M:
            height = round(RETURN_SHARE * fence.height_m, 2)
            yield Line("MIS_TAKEOFF_ALT", height, "AUTO.TAKEOFF stays under the fence's ceiling [m]", reason)

    def landing(self) -> Iterator[Line]:
        ceiling = min(
            self.required.ceiling_m, self.required.fence.height_m if self.required.fence else math.inf
        )
        height = round(RETURN_SHARE * ceiling, 2)
        for name, most in _RETURN.items():
            what = (
                "AUTO.RTL stays under the ceiling [m]"
                if name == "RTL_RETURN_ALT"
                else "where AUTO.RTL waits before it lands [m]"
            )
            held = self._held(name, min(height, most), f"ceiling_m: {ceiling:g} m")
            yield Line(name, held, what, self._reason("ceiling_m"))
        yield Line("MPC_TKO_RAMP_T", 1.0, "a brisk take-off [s]", self._reason("takeoff"))
        if self.required.landing_speed_m_s is not None:
            speed = self._held("MPC_LAND_SPEED", self.required.landing_speed_m_s, "landing_speed_m_s")
            yield Line("MPC_LAND_SPEED", speed, "landing speed [m/s]", self._reason("landing_speed_m_s"))

    def vehicle(self) -> Iterator[Line]:
        required = self.required
        yield Line("MAV_SYS_ID", required.system_id, "who it is", self._reason("system_id"))
        yield Line("MPC_THR_HOVER", required.hover, "thrust that carries it", self._reason("hover"))
        for name, value in required.gains.items():
            old = _VELOCITY_GAINS.get(name)
            if name in self.known:
                yield Line(name, value, "a gain of its profile", self._reason("gains"))
            elif old in self.known:
                yield Line(
                    str(old),
                    value * required.hover / GRAVITY_M_S2,
                    f"a gain of its profile, {name} then",
                    self._reason("gains"),
                )
            else:
                self.not_possible.append(f"gains: PX4 {self.version} has no {name} ({value:g})")
        if not required.rotors:
            return
        if "CA_ROTOR_COUNT" not in self.known:
            self.not_possible.append(
                f"geometry: PX4 {self.version} takes its rotors from a mixer file, not from parameters"
            )
            return
        reason = self._reason("rotors")
        yield Line("CA_ROTOR_COUNT", len(required.rotors), "rotors", reason)
        for k, rotor in enumerate(required.rotors):
            yield Line(f"CA_ROTOR{k}_PX", rotor.x_m, f"rotor {k + 1}: forward [m]", reason)
            yield Line(f"CA_ROTOR{k}_PY", rotor.y_m, f"rotor {k + 1}: right [m]", reason)
            yield Line(
                f"CA_ROTOR{k}_KM",
                rotor.spin * required.moment_ratio_m,
                f"rotor {k + 1}: torque over thrust [m]",
                reason,
            )

    def own(self) -> Iterator[Line]:
        for name, value in self.required.own.items():
            if name not in self.known:
                self.not_possible.append(f"params: PX4 {self.version} has no {name}")
            yield Line(name, value, "as written", self._reason(f"own.{name}"))

    def _react(
        self, need: str, event: Event, action: Action, when: str, *, quiet: bool = False
    ) -> Iterator[Line]:
        """quiet: this event is a twin of another, which has said already what cannot be."""
        try:
            found = ways(event, action, self.version)
        except InputError as error:
            if not quiet:
                self.not_possible.append(f"failsafe.{need}: {error}")
            return
        for name, value in found.items():
            yield Line(name, value, f"{action} when {when}", self._reason(f"failsafe.{need}"))

    def _ways(self, event: Event, action: Action) -> Mapping[str, int]:
        try:
            return ways(event, action, self.version)
        except InputError:
            return {}

    def _after(self, need: str, event: Event, name: str, seconds: float, what: str) -> Iterator[Line]:
        """Less what passes before the parameter's own time begins."""
        delay = next((d for d in delays(event, self.version) if d.parameter == name), None)
        scale, fixed = (delay.scale, delay.fixed_s) if delay else (1.0, 0.0)
        held = self._held(name, (seconds - fixed) / scale, f"failsafe.{need}: {seconds:g} s")
        yield Line(name, held, what, self._reason(f"failsafe.{need}"))

    def _held(self, name: str, value: float, need: str) -> float:
        """The nearest value that PX4 takes, a whole number where it keeps those; said when it is another one."""
        known = self.known[name]
        held = min(
            max(value, -math.inf if known.min is None else known.min),
            math.inf if known.max is None else known.max,
        )
        if abs(held - value) > 1e-6 * max(1.0, abs(value)):
            self.not_possible.append(
                f"{need} would be {name} {value:g}, which PX4 {self.version} does not take; {held:g} is set"
            )
        return round(held) if known.type == "INT32" else held

    def _reason(self, need: str) -> str:
        return self.required.reasons.get(need, "arena's default")
