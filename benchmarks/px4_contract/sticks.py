"""Cases with a pilot: flight in the manual modes by MANUAL_CONTROL, lost sticks, takeover by moved sticks, gestures."""

from __future__ import annotations

import math

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import yaw_from_quat
from px4_contract.failing import outcome
from px4_contract.flying import come_down, complaint, hover, state
from px4_contract.registry import case
from px4_contract.rig import Each, Rig, Setup, Unfit
from px4_contract.transcript import Transcript

WITH_JOYSTICK = {"COM_RC_IN_MODE": 1, "NAV_RCL_ACT": 3, "COM_RCL_EXCEPT": 7, "MPC_VEL_MANUAL": 3.0}
MODES = {"POSCTL": 3, "ALTCTL": 2, "STABILIZED": 7, "ACRO": 5, "MANUAL": 1}


def as_ground_station(r: Rig) -> None:
    """Send everything as a ground station: in an arena, a pilot's sticks keep programs out."""
    r.links["router"].voice = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


def sticks(*, pitch: float = 0.0, roll: float = 0.0, throttle: float = 0.0, yaw: float = 0.0) -> Each:
    """Return a function for `each` that sends these stick positions, -1..1, at every tick."""
    x, y, r = (round(1000 * value) for value in (pitch, roll, yaw))
    z = round(500 * (throttle + 1.0))
    return lambda rig: rig.send(mavlink.MAVLink_manual_control_message(rig.id, x, y, z, r, 0))


CENTRE = sticks()


def hold_sticks(r: Rig, each: Each, seconds: float) -> None:
    """Send stick positions for some seconds, and then centred sticks."""
    r.each[:] = [each]
    r.run(seconds)
    r.each[:] = [CENTRE]


def take_off(r: Rig) -> None:
    """Hover in POSCTL at about 4 m. Raises Unfit if the vehicle does not get there."""
    as_ground_station(r)
    r.each[:] = [CENTRE]
    r.run(0.5)
    r.set_mode(3)
    r.arm()
    r.run(1.5)
    r.each[:] = [sticks(throttle=0.8)]
    up = r.until(lambda r: r.p_n[2] < -4.0, 20.0)
    r.each[:] = [CENTRE]
    r.run(3.0)
    if up is None:
        raise Unfit(f"it does not take off by hand: {r.mode} armed {r.armed} at {r.p_n}; {r.texts()}")


def body_velocity(r: Rig) -> tuple[float, float]:
    """Return the true velocity ahead and to the right [m/s]."""
    v, yaw = r.truth().v_n[0], float(yaw_from_quat(r.truth().q_nb[0]))
    return (
        float(v[0] * math.cos(yaw) + v[1] * math.sin(yaw)),
        float(v[1] * math.cos(yaw) - v[0] * math.sin(yaw)),
    )


@case(
    "by hand, position mode",
    "take-off, flight to each side, turn and landing in POSCTL by MANUAL_CONTROL",
    ground=False,
    setup=Setup(params=WITH_JOYSTICK),
)
def position_mode(r: Rig, t: Transcript) -> None:
    as_ground_station(r)
    r.each[:] = [CENTRE]
    r.run(0.5)
    t.note("mode ack", r.set_mode(3))
    t.note("arm ack", r.arm())
    t.note("base_mode", r.settle().state["HEARTBEAT"].base_mode)
    r.run(2.0)
    t.note("stays down with centred sticks", bool(r.p_n[2] > -0.15))
    r.each[:] = [sticks(throttle=0.8)]
    up = r.until(lambda r: r.p_n[2] < -1.6, 20.0)
    t.number("climbs 1.6 m in", up, near=0.4, part=0.15, unit="s")
    r.each[:] = [CENTRE]
    r.run(4.0)
    before = r.p_n.copy()
    r.run(3.0)
    t.number("drifts in 3 s", float(np.linalg.norm(r.p_n - before)), near=0.15, unit="m")
    for name, each in (
        ("right", sticks(roll=0.6)),
        ("left", sticks(roll=-1.0)),
        ("ahead", sticks(pitch=0.6)),
        ("back", sticks(pitch=-1.0)),
    ):
        r.each[:] = [each]
        r.run(3.5)
        ahead, right = body_velocity(r)
        t.number(f"{name}: speed ahead", ahead, near=0.25, part=0.12, unit="m/s")
        t.number(f"{name}: speed to the right", right, near=0.25, part=0.12, unit="m/s")
        r.each[:] = [CENTRE]
        begin = r.p_n.copy()
        r.until(lambda r: float(np.linalg.norm(r.truth().v_n[0][:2])) < 0.08, 8.0)
        t.number(
            f"{name}: stops within", float(np.linalg.norm((r.p_n - begin)[:2])), near=0.4, part=0.25, unit="m"
        )
        r.run(3.0)
        stopped = r.p_n.copy()
        r.run(2.0)
        t.number(f"{name}: then drifts", float(np.linalg.norm(r.p_n - stopped)), near=0.15, unit="m")
    r.each[:] = [sticks(yaw=0.5)]
    r.run(1.0)
    t.number("yaw to the right: rate", float(r.truth().omega_b[0][2]), near=0.15, part=0.15, unit="rad/s")
    r.each[:] = [CENTRE]
    r.run(3.0)
    height = -r.p_n[2]
    hold_sticks(r, sticks(throttle=1.0), 2.0)
    r.run(2.0)
    t.number("climbs in 2 s", float(-r.p_n[2] - height), near=0.5, part=0.2, unit="m")
    r.each[:] = [sticks(throttle=-1.0)]
    t.number("lands and disarms in", r.until(lambda r: not r.armed, 30.0), near=3.0, part=0.3, unit="s")
    t.note("mode after disarming", r.settle().mode)


@case(
    "by hand, altitude and stabilized mode",
    "tilt, height and motion with a deflected stick in ALTCTL, STABILIZED and ACRO",
    ground=False,
    setup=Setup(params=WITH_JOYSTICK),
)
def other_modes(r: Rig, t: Transcript) -> None:
    take_off(r)
    for name, main in (("ALTCTL", 2), ("STABILIZED", 7)):
        t.note(f"{name}: ack", r.set_mode(main))
        t.note(f"{name}: mode", r.settle().mode)
        height = -r.p_n[2]
        r.each[:] = [sticks(roll=0.3)]
        r.run(0.8)
        q = r.truth().q_nb[0]
        tilt = math.degrees(math.acos(1 - 2 * float(q[1] ** 2 + q[2] ** 2)))
        t.number(f"{name}: tilt", tilt, near=1.5, part=0.1, unit="deg")
        _, right = body_velocity(r)
        t.number(f"{name}: speed to the right", right, near=0.4, part=0.25, unit="m/s")
        r.each[:] = [CENTRE]
        if name == "ALTCTL":
            r.run(1.0)
            t.number(f"{name}: height", float(-r.p_n[2] - height), near=0.2, unit="m")
        t.note(f"{name}: back to POSCTL", r.set_mode(3))
        r.run(4.0)
    t.note("ACRO: ack", r.set_mode(5))
    r.each[:] = [sticks(roll=0.4, throttle=0.1)]
    r.run(0.3)
    t.number("ACRO: roll rate", float(r.truth().omega_b[0][0]), near=0.15, part=0.1, unit="rad/s")
    r.each[:] = [CENTRE]
    t.note("ACRO: back to POSCTL", r.set_mode(3))
    r.run(3.0)
    come_down(r)


@case(
    "by hand, change of modes",
    "manual modes requested while hovering in HOLD, with and without sticks",
    ground=False,
    setup=Setup(params=WITH_JOYSTICK),
)
def change_modes(r: Rig, t: Transcript) -> None:
    take_off(r)
    for name, main in MODES.items():
        r.set_mode(4, 3)
        r.clear()
        t.note(f"{name} with sticks: ack", r.set_mode(main))
        t.note(f"{name} with sticks: mode", r.settle().mode)
        complaint(r, t, f"{name} with sticks")
        r.set_mode(3)
        r.run(1.5)
    r.set_mode(4, 3)
    r.each.clear()
    r.run(1.5)
    t.note("sticks off in HOLD: mode", r.settle().mode)
    for name, main in MODES.items():
        t.note(f"{name} without sticks: ack", r.set_mode(main))
        t.note(f"{name} without sticks: mode", r.settle().mode)
    come_down(r)


@case(
    "sticks lost in POSCTL",
    "MANUAL_CONTROL stops while the stick is deflected, NAV_RCL_ACT 3 (land)",
    ground=False,
    setup=Setup(params={**WITH_JOYSTICK, "COM_FAIL_ACT_T": 0.0}),
)
def sticks_lost(r: Rig, t: Transcript) -> None:
    take_off(r)
    r.command(511, 436, 50_000)
    r.each[:] = [sticks(roll=0.6)]
    r.run(2.0)
    r.each.clear()
    r.clear()
    outcome(r, t)


def _override(value: int, mode: str) -> None:
    @case(
        f"sticks moved in {mode}, COM_RC_OVERRIDE {value}",
        "the roll stick moves quickly: does the pilot take over, and can the program return",
        ground=False,
        setup=Setup(params={**WITH_JOYSTICK, "COM_RC_OVERRIDE": value}),
    )
    def run(r: Rig, t: Transcript) -> None:
        as_ground_station(r)
        hover(r)
        r.each.append(CENTRE)
        r.run(1.0)
        if mode != "OFFBOARD":
            r.set_mode(4, 3 if mode == "AUTO.LOITER" else 6)
        r.clear()
        r.each[-1] = sticks(roll=0.02)
        r.run(0.5)
        t.note("slow stick: mode", r.mode)
        r.each[-1] = sticks(roll=0.8)
        r.run(0.4)
        r.each[-1] = CENTRE
        t.note("mode", r.settle().mode)
        complaint(r, t, "moved")
        t.note("back to OFFBOARD: ack", r.set_mode(6))
        t.note("back to OFFBOARD: mode", r.settle().mode)
        come_down(r)


for _value, _mode in (
    (1, "OFFBOARD"),
    (3, "OFFBOARD"),
    (1, "AUTO.LOITER"),
    (0, "AUTO.LOITER"),
    (1, "AUTO.LAND"),
):
    _override(_value, _mode)


@case(
    "sticks of a disarmed vehicle",
    "the mode that the first sticks select, arming with each stick position, and the gestures",
    ground=False,
    setup=Setup(params=WITH_JOYSTICK),
)
def on_the_ground(r: Rig, t: Transcript) -> None:
    as_ground_station(r)
    r.each[:] = [CENTRE]
    t.note("first sticks: mode", r.settle().mode)
    for name, main in (("POSCTL", 3), ("STABILIZED", 7)):
        r.set_mode(main)
        for throttle in (-1.0, 0.0, 0.5):
            r.each[:] = [sticks(throttle=throttle)]
            r.run(0.3)
            t.note(f"{name}: arm with the throttle at {throttle:g}", r.arm())
            r.run(0.3)
            r.disarm()
            r.until(lambda r: not r.armed, 15.0)
    r.set_mode(3)
    r.each[:] = [sticks(throttle=-1.0, yaw=1.0)]
    t.number("gesture arms after", r.until(lambda r: r.armed, 5.0), near=1.2, unit="s")
    r.each[:] = [sticks(throttle=-1.0)]
    r.run(1.0)
    r.each[:] = [sticks(throttle=-1.0, yaw=-1.0)]
    t.number("gesture disarms after", r.until(lambda r: not r.armed, 5.0), near=1.2, unit="s")
    r.set_mode(4, 3)
    r.each[:] = [sticks(throttle=-1.0, yaw=1.0)]
    r.run(3.0)
    t.note("gesture in HOLD: state", state(r))
    r.each.clear()
    state(r)
