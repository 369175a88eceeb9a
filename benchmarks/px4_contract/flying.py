"""Cases in the autopilot's own modes: take-off, hold, land, and commands and mode changes in the air."""

from __future__ import annotations

import math

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from px4_contract.link import RATES_S, contents, rates
from px4_contract.registry import case
from px4_contract.rig import Rig, Setup, Unfit
from px4_contract.transcript import Transcript

NAN = math.nan
_ON_A_CIRCLE = ("orbit", "set mode HOLD again")
SKIP_FLYING = ("PARAM_VALUE",)


def hover(r: Rig, height: float = 1.5, *, stream: bool = True) -> None:
    """Hover in OFFBOARD at `height` [m] above the floor. Raises Unfit if the vehicle does not get there.

    stream: whether setpoints continue to be sent afterwards
    """
    setpoint = r.position(0.0, 0.0, -height)
    r.each.append(setpoint)
    r.run(0.5)
    r.set_mode(6)
    r.until(lambda r: r.mode == "OFFBOARD", 2.0)
    r.arm()
    r.until(lambda r: r.armed, 2.0)
    took = r.until(lambda r: abs(r.p_n[2] + height) < 0.15 and np.linalg.norm(r.truth().v_n[0]) < 0.1, 20.0)
    if took is None:
        raise Unfit(f"it does not hover: {r.mode} armed {r.armed} at {r.p_n}; {r.texts()}")
    r.run(1.0)
    if not stream:
        r.each.remove(setpoint)


def come_down(r: Rig) -> None:
    """Land from any state, and disarm by force if the vehicle does not disarm by itself."""
    r.each.clear()
    r.set_mode(4, 6)
    if r.until(lambda r: not r.armed, 15.0) is None:
        r.disarm(force=True)


def state(r: Rig) -> str:
    """Return mode and arming state of the next heartbeat."""
    r.settle()
    return f"{r.mode} {'armed' if r.armed else 'disarmed'}"


def complaint(r: Rig, t: Transcript, key: str) -> None:
    texts = r.texts()
    t.note(f"{key}: complains", any(s <= 4 for s, _ in texts))
    t.words(f"{key}: texts", "; ".join(f"{s} {x}" for s, x in texts))


def watch_modes(r: Rig) -> list[tuple[float, str, int]]:
    """Return every received change of (mode, armed) and of landed_state: (time, words, landed state)."""
    found: list[tuple[float, str, int]] = []
    mode, landed = "", -1
    from arena.wire.px4_mode import mode_words

    for h in r.received:
        if h.name == "HEARTBEAT":
            new = f"{mode_words(h.m.custom_mode)} {'armed' if h.m.base_mode & 128 else 'disarmed'}"
            if new != mode:
                mode = new
                found.append((h.t, mode, landed))
        elif h.name == "EXTENDED_SYS_STATE" and h.m.landed_state != landed:
            landed = h.m.landed_state
            found.append((h.t, mode, landed))
    return found


@case(
    "take off and land",
    "MAV_CMD_NAV_TAKEOFF from HOLD, hold, MAV_CMD_NAV_LAND: times, heights and states during the flight",
    ground=False,
)
def takeoff_land(r: Rig, t: Transcript) -> None:
    t.note("arm ack", r.arm())
    t.note("after arming", state(r))
    t.note("landed_state after arming", r.state["EXTENDED_SYS_STATE"].landed_state)
    r.run(0.5).clear()
    r.command(511, 436, 50_000)
    r.command(511, 245, 50_000)
    begin = r.now
    t.note("takeoff ack", r.command(22, NAN, 0, 0, NAN, NAN, NAN, NAN))
    up = r.until(lambda r: r.p_n[2] < -0.15, 10.0)
    t.number("leaves the floor", up, near=1.0, part=0.35, unit="s")
    air = r.until(lambda r: r.state["EXTENDED_SYS_STATE"].landed_state == 2, 10.0)
    t.note("in the air", air is not None)
    done = r.until(lambda r: r.mode != "AUTO.TAKEOFF", 20.0)
    t.number("take-off lasts", r.now - begin if done is not None else None, near=1.5, part=0.3, unit="s")
    t.note("mode after it", r.mode)
    t.note("armed after it", r.armed)
    t.number("height at the change", -r.p_n[2], near=0.4, unit="m")
    r.run(5.0)
    t.number("height held", -r.p_n[2], near=0.25, unit="m")
    t.number("drifted", float(np.hypot(*r.p_n[:2])), near=0.25, unit="m")
    states = [s for _, _, s in watch_modes(r)]
    t.note(
        "landed_state seen on the way", " ".join(str(s) for s in dict.fromkeys(s for s in states if s >= 0))
    )
    r.clear()
    t.note("disarm in the air: ack", r.disarm())
    t.note("disarm in the air: state", state(r))
    complaint(r, t, "disarm in the air")
    r.clear()
    begin = r.now
    t.note("land ack", r.command(21, 0, 0, 0, NAN, NAN, NAN, NAN))
    t.note("after land", r.mode)
    r.until(lambda r: r.p_n[2] > -0.1, 20.0)
    touched = r.now
    t.number("touches down after", touched - begin, near=1.0, part=0.3, unit="s")
    landed = r.until(lambda r: r.on_ground, 10.0)
    t.number("reports landed after", landed, near=0.8, part=0.3, unit="s")
    disarmed = r.until(lambda r: not r.armed, 10.0)
    t.number("disarms after landed", disarmed, near=0.8, part=0.3, unit="s")
    r.run(2.0)
    t.note("mode after disarming", r.mode)
    t.note("landed_state", r.state["EXTENDED_SYS_STATE"].landed_state)
    t.words("texts", "; ".join(f"{s} {x}" for s, x in r.texts()))


@case(
    "take off to a height",
    "MAV_CMD_NAV_TAKEOFF with an altitude above sea level and a position",
    ground=False,
)
def takeoff_to(r: Rig, t: Transcript) -> None:
    r.run(3.0)
    place = r.state.get("GLOBAL_POSITION_INT")
    r.arm()
    r.clear()
    above = place.alt / 1e3 + 1.5 if place else 1.5
    t.note("global position before", place is not None)
    t.note("ack", r.command(22, 0, 0, 0, NAN, NAN, NAN, above))
    done = r.until(lambda r: r.mode == "AUTO.LOITER" and r.p_n[2] < -0.5, 20.0)
    t.note("gets there", done is not None)
    r.run(4.0)
    t.number("height", -r.p_n[2], near=0.3, unit="m")
    come_down(r)


@case(
    "take off, disarmed",
    "MAV_CMD_NAV_TAKEOFF and MAV_CMD_NAV_LAND to a disarmed vehicle on the ground",
    ground=False,
)
def takeoff_disarmed(r: Rig, t: Transcript) -> None:
    for key, number in (("takeoff", 22), ("land", 21), ("return", 20)):
        r.clear()
        t.note(f"{key}: ack", r.command(number, 0, 0, 0, NAN, NAN, NAN, NAN))
        r.run(1.0)
        t.note(f"{key}: state", state(r))
        complaint(r, t, key)
        t.note(f"{key}: arms then", r.arm())
        t.note(f"{key}: state after arming", state(r))
        complaint(r, t, f"{key}, then arming")
        r.run(3.0)
        t.note(f"{key}: leaves the floor", bool(r.p_n[2] < -0.3))
        come_down(r)
        r.set_mode(4, 3)


@case("land on the ground", "armed in HOLD on the floor, then AUTO.LAND: time until it disarms", ground=False)
def land_on_ground(r: Rig, t: Transcript) -> None:
    r.arm()
    r.run(1.0)
    t.note("ack", r.set_mode(4, 6))
    t.number("disarms after", r.until(lambda r: not r.armed, 15.0), near=0.8, part=0.3, unit="s")
    t.note("mode after", r.settle().mode)


@case("modes in the air", "every main and sub mode requested while hovering in OFFBOARD", ground=False)
def modes_in_air(r: Rig, t: Transcript) -> None:
    hover(r)
    r.command(511, 436, 50_000)
    asked = [(m, 0) for m in (1, 2, 3, 5, 7, 8, 9, 10)] + [
        (4, s) for s in (0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 15, 18, 99)
    ]
    for main, sub in asked:
        r.clear()
        t.note(f"{main}.{sub}: ack", r.set_mode(main, sub))
        r.run(0.2)
        t.note(f"{main}.{sub}: mode after", r.mode)
        t.note(f"{main}.{sub}: complains", any(s <= 4 for s, _ in r.texts()))
        t.words(f"{main}.{sub}: texts", "; ".join(f"{s} {x}" for s, x in r.texts()))
        t.note(f"{main}.{sub}: back to OFFBOARD", r.set_mode(6))
        r.until(lambda r: abs(r.p_n[2] + 1.5) < 0.3, 5.0)
        if not r.armed:
            t.note(f"{main}.{sub}: disarmed in the air", True)
            return
    come_down(r)


@case(
    "commands in the air",
    "commands to a vehicle in HOLD: acknowledgement, mode afterwards, distance moved",
    ground=False,
)
def commands_in_air(r: Rig, t: Transcript) -> None:
    hover(r)
    r.set_mode(4, 3)
    r.each.clear()
    r.run(2.0)
    g = r.state.get("GLOBAL_POSITION_INT")
    lat, lon = (g.lat * 1e-7, g.lon * 1e-7) if g else (0.0, 0.0)
    alt = g.alt / 1e3 if g else 0.0
    step = math.degrees(2.0 / 6371000.0)
    for name, number, p, way in (
        ("loiter unlimited", 17, (), "long"),
        ("pause", 193, (0,), "long"),
        ("continue", 193, (1,), "long"),
        ("change speed", 178, (1, 2, -1, 0), "long"),
        ("arm, armed", 400, (1,), "long"),
        ("reboot", 246, (1,), "long"),
        ("calibrate gyro", 241, (1,), "long"),
        ("set home here", 179, (1,), "long"),
        ("takeoff", 22, (0, 0, 0, NAN, NAN, NAN, alt + 2), "long"),
        ("set mode HOLD", 176, (1, 4, 3), "long"),
        ("arm 2", 400, (2,), "long"),
        ("actuator test", 310, (0.1, 1, 0, 0, 1), "long"),
        ("motor test", 209, (1, 0, 10, 1), "long"),
        ("reposition 2 m north", 192, (-1, 1, 0, NAN, lat + step, lon, alt), "long"),
        (
            "reposition back by COMMAND_INT",
            192,
            (-1, 1, 0, NAN, round(lat * 1e7), round(lon * 1e7), alt),
            "int",
        ),
        ("reposition nowhere", 192, (-1, 1, 0, NAN, NAN, NAN, NAN), "long"),
        ("orbit", 34, (2, 1, 0, NAN, NAN, NAN, NAN), "long"),
        ("set mode HOLD again", 176, (1, 4, 3), "long"),
    ):
        r.clear()
        before = r.p_n.copy()
        t.note(f"{name}: ack", r.command(number, *p, way=way))
        r.run(4.0)
        t.note(f"{name}: state after", state(r))
        north = float(r.p_n[0] - before[0])
        if name in _ON_A_CIRCLE:  # its place on the circle differs from run to run
            t.words(f"{name}: north", f"{north:.3g} m")
        else:
            t.number(f"{name}: north", north, near=0.5, part=0.3, unit="m")
        t.number(f"{name}: down", float(r.p_n[2] - before[2]), near=0.5, part=0.3, unit="m")
        complaint(r, t, name)
    come_down(r)


@case(
    "rates and contents in the air",
    "every message with its rate and contents, hovering in OFFBOARD",
    ground=False,
)
def rates_flying(r: Rig, t: Transcript) -> None:
    hover(r)
    r.clear()
    r.run(RATES_S)
    rates(r, t, "router", SKIP_FLYING)
    contents(r, t)
    m = r.state["HEARTBEAT"]
    t.note("HEARTBEAT base_mode", m.base_mode)
    t.note("HEARTBEAT system_status", m.system_status)
    come_down(r)
    r.run(1.0)
    t.note("after landing", state(r))


@case("by force", "disarmed by force while hovering: it falls and reports it", ground=False)
def by_force(r: Rig, t: Transcript) -> None:
    hover(r)
    r.clear()
    t.note("disarm with another number: ack", r.command(400, 0, 12345))
    t.note("disarm with another number: state", state(r))
    t.note("disarm by force: ack", r.disarm(force=True))
    r.run(2.0)
    t.note("state", state(r))
    t.note("it falls", bool(r.p_n[2] > -0.3))
    complaint(r, t, "disarm by force")


@case("manual control", "MANUAL_CONTROL to a hovering vehicle without manual control", ground=False)
def manual_control(r: Rig, t: Transcript) -> None:
    hover(r)
    r.clear()
    for _ in range(100):
        r.send(mavlink.MAVLink_manual_control_message(r.id, 1000, 1000, 900, 1000, 0))
        r.tick()
    t.note("state", state(r))
    t.note("moved", bool(abs(r.p_n[2] + 1.5) > 0.4 or np.hypot(*r.p_n[:2]) > 0.4))
    come_down(r)


@case(
    "other setters",
    "messages outside the contract that change something: movement of a hovering vehicle",
    ground=False,
    setup=Setup(),
)
def other_setters(r: Rig, t: Transcript) -> None:
    hover(r)
    q = [1.0, 0.0, 0.0, 0.0]
    nan21 = [NAN] * 21
    for key, m in (
        (
            "SET_ACTUATOR_CONTROL_TARGET",
            mavlink.MAVLink_set_actuator_control_target_message(0, 0, r.id, 1, [0.0] * 8),
        ),
        ("RC_CHANNELS_OVERRIDE", mavlink.MAVLink_rc_channels_override_message(r.id, 1, *[1000] * 8)),
        ("ATT_POS_MOCAP far off", mavlink.MAVLink_att_pos_mocap_message(0, q, 9.0, 9.0, -9.0, nan21)),
        (
            "SET_HOME_POSITION",
            mavlink.MAVLink_set_home_position_message(r.id, 473978000, 85456000, 500000, 0, 0, 0, q, 0, 0, 0),
        ),
        ("SET_GPS_GLOBAL_ORIGIN", mavlink.MAVLink_set_gps_global_origin_message(r.id, 400_000_000, 0, 0)),
    ):
        r.clear()
        for _ in range(50):
            r.send(m)
            r.tick()
        t.note(f"{key}: state", state(r))
        t.note(f"{key}: moved", bool(abs(r.p_n[2] + 1.5) > 0.4 or np.hypot(*r.p_n[:2]) > 0.4))
    come_down(r)
