"""Cases of telemetry: heartbeat, capabilities, and every message of each link with its rate and contents."""

from __future__ import annotations

import math
import struct
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from px4_contract.registry import case
from px4_contract.rig import Rig, Setup
from px4_contract.transcript import Transcript

SENSORS = {
    v: k.removeprefix("MAV_SYS_STATUS_").removeprefix("SENSOR_").lower()
    for k, v in vars(mavlink).items()
    if k.startswith("MAV_SYS_STATUS_")
    and isinstance(v, int)
    and v > 0
    and "RECOVERY" not in k
    and "LEAK" not in k
    and not k.endswith("ENUM_END")
}
CAPABILITIES = {
    v: k.removeprefix("MAV_PROTOCOL_CAPABILITY_").lower()
    for k, v in vars(mavlink).items()
    if k.startswith("MAV_PROTOCOL_CAPABILITY_") and isinstance(v, int) and not k.endswith("ENUM_END")
}
RATES_S = 20.0


def bits(value: int, names: dict[int, str]) -> str:
    """Return the names of the bits that are set, in order."""
    return " ".join(name for bit, name in sorted(names.items()) if value & bit) or "none"


def rate(t: Transcript, key: str, count: int, seconds: float) -> None:
    """Record the rate of a message [Hz]. A difference of one message or 10 % is accepted."""
    t.number(key, count / seconds, near=1.5 / seconds, part=0.1, unit="Hz")


def rates(r: Rig, t: Transcript, link: str, skip: tuple[str, ...] = ()) -> None:
    for name, count in sorted(r.counted[link].items()):
        if name not in ("STATUSTEXT", "COMMAND_ACK", "id 410", *skip):
            rate(t, f"{name} on {link}", count, RATES_S)


@case("heartbeat", "the fields of HEARTBEAT, disarmed in HOLD")
def heartbeat(r: Rig, t: Transcript) -> None:
    r.run(2.0)
    m = r.state["HEARTBEAT"]
    for name in ("type", "autopilot", "base_mode", "system_status", "mavlink_version"):
        t.note(name, getattr(m, name))
    t.note("custom mode", r.mode)
    t.note("component", m.get_srcComponent())


@case("capabilities", "AUTOPILOT_VERSION and the ways to request it")
def capabilities(r: Rig, t: Transcript) -> None:
    for key, answer in (
        ("by request message", lambda: r.command(512, 148)),
        ("by request capabilities", lambda: r.command(520, 1)),
    ):
        r.clear()
        t.note(f"{key}: ack", answer())
        found = r.all("AUTOPILOT_VERSION")
        t.note(f"{key}: comes", bool(found))
        if found:
            m = found[-1]
            t.note("capabilities", bits(m.capabilities, CAPABILITIES))
            t.note("flight_sw_version", f"{m.flight_sw_version:#x}")
            t.words("custom version", bytes(m.flight_custom_version).decode(errors="replace").strip("\0"))
            t.note("vendor and product", f"{m.vendor_id} {m.product_id}")
            t.note("has uid", bool(m.uid))
    r.clear()
    t.note("protocol version: ack", r.command(519, 1))
    t.note("protocol version: comes", any(h.msgid == 300 for h in r.received))


@case("rates, disarmed", "every message of the three links with its rate, disarmed")
def rates_disarmed(r: Rig, t: Transcript) -> None:
    r.run(1.0).clear()
    r.run(RATES_S)
    for link in ("router", "vision", "panic"):
        rates(r, t, link)


def newest(r: Rig, name: str) -> Any:
    return next((h.m for h in reversed(r.received) if h.name == name and h.m is not None), None)


def finite(*values: float) -> str:
    return " ".join("nan" if math.isnan(v) else "finite" if math.isfinite(v) else "inf" for v in values)


def contents(r: Rig, t: Transcript) -> None:  # noqa: C901 - a list, not a decision
    """Record the fields of each message. Numbers are recorded only if both vehicles must agree on them."""
    if m := newest(r, "SYS_STATUS"):
        # Whether a disarmed vehicle is logged depends on what it did before: the case "SYS_STATUS, logging" observes it.
        changing = 0 if r.armed else mavlink.MAV_SYS_STATUS_LOGGING
        t.note("SYS_STATUS present", bits(m.onboard_control_sensors_present & ~changing, SENSORS))
        t.note("SYS_STATUS enabled", bits(m.onboard_control_sensors_enabled & ~changing, SENSORS))
        t.note("SYS_STATUS health", bits(m.onboard_control_sensors_health & ~changing, SENSORS))
        t.number("SYS_STATUS battery_remaining", m.battery_remaining, near=10, unit="%")
        t.number("SYS_STATUS voltage", m.voltage_battery / 1e3, near=0.8, unit="V")
        t.note("SYS_STATUS current known", m.current_battery != -1)
    if m := newest(r, "BATTERY_STATUS"):
        t.note(
            "BATTERY_STATUS",
            f"id {m.id} function {m.battery_function} type {m.type} state {m.charge_state} mode {m.mode}",
        )
        t.note("BATTERY_STATUS temperature known", m.temperature != 32767)
        t.note("BATTERY_STATUS cells", sum(v != 65535 for v in m.voltages))
        t.number("BATTERY_STATUS remaining", m.battery_remaining, near=10, unit="%")
        t.note("BATTERY_STATUS consumed known", m.current_consumed != -1)
        t.note("BATTERY_STATUS time left known", m.time_remaining != 0)
    if m := newest(r, "EXTENDED_SYS_STATE"):
        t.note("EXTENDED_SYS_STATE", f"vtol {m.vtol_state} landed {m.landed_state}")
    if m := newest(r, "HIGHRES_IMU"):
        t.note("HIGHRES_IMU fields", f"id {m.id}")
        t.number("HIGHRES_IMU zacc", m.zacc, near=0.6, unit="m/s2")
        t.number("HIGHRES_IMU abs_pressure", m.abs_pressure, near=5, part=0.001, unit="hPa")
        t.number("HIGHRES_IMU temperature", m.temperature, near=40, unit="C")
    if m := newest(r, "ESTIMATOR_STATUS"):
        names = {
            v: k[10:].lower()
            for k, v in vars(mavlink).items()
            if k.startswith("ESTIMATOR_") and isinstance(v, int) and v & (v - 1) == 0
        }
        t.note("ESTIMATOR_STATUS flags", bits(m.flags, names))
    if m := newest(r, "LOCAL_POSITION_NED"):
        for axis, at in zip("xyz", r.p_n, strict=True):
            t.number(
                f"LOCAL_POSITION_NED {axis} off the truth", getattr(m, axis) - float(at), near=0.06, unit="m"
            )
    if m := newest(r, "ODOMETRY"):
        t.note("ODOMETRY", f"frame {m.frame_id} child {m.child_frame_id} estimator {m.estimator_type}")
        t.note("ODOMETRY pose covariance", finite(*(m.pose_covariance[k] for k in (0, 1, 6, 11, 15, 18, 20))))
        t.note(
            "ODOMETRY velocity covariance",
            finite(*(m.velocity_covariance[k] for k in (0, 1, 6, 11, 15, 18, 20))),
        )
    if m := newest(r, "ATTITUDE_TARGET"):
        t.note("ATTITUDE_TARGET type_mask", m.type_mask)
    if m := newest(r, "POSITION_TARGET_LOCAL_NED"):
        t.note("POSITION_TARGET_LOCAL_NED frame and mask", f"{m.coordinate_frame} {m.type_mask:#x}")
    if m := newest(r, "SERVO_OUTPUT_RAW"):
        t.note("SERVO_OUTPUT_RAW port", m.port)
        t.number("SERVO_OUTPUT_RAW servo1", m.servo1_raw, near=120, unit="us")
        t.number("SERVO_OUTPUT_RAW servo5", m.servo5_raw, near=1, unit="us")
    if m := newest(r, "VFR_HUD"):
        t.number("VFR_HUD throttle", m.throttle, near=6, unit="%")
        t.note("VFR_HUD airspeed", finite(m.airspeed))
    if m := newest(r, "ALTITUDE"):
        t.note(
            "ALTITUDE",
            finite(
                m.altitude_monotonic,
                m.altitude_amsl,
                m.altitude_local,
                m.altitude_relative,
                m.altitude_terrain,
                m.bottom_clearance,
            ),
        )
        t.number("ALTITUDE local", m.altitude_local, near=0.15, unit="m")
        t.number("ALTITUDE relative", m.altitude_relative, near=0.15, unit="m")
        t.number("ALTITUDE amsl", m.altitude_amsl, near=0.5, unit="m")
    if m := newest(r, "GLOBAL_POSITION_INT"):
        t.number("GLOBAL_POSITION_INT lat", m.lat * 1e-7, near=1e-6, unit="deg")
        t.number("GLOBAL_POSITION_INT lon", m.lon * 1e-7, near=1e-6, unit="deg")
        t.number("GLOBAL_POSITION_INT alt", m.alt / 1e3, near=0.5, unit="m")
        t.number("GLOBAL_POSITION_INT relative_alt", m.relative_alt / 1e3, near=0.15, unit="m")
        t.note("GLOBAL_POSITION_INT heading known", m.hdg != 65535)
    if m := newest(r, "HOME_POSITION"):
        t.number("HOME_POSITION latitude", m.latitude * 1e-7, near=1e-6, unit="deg")
        t.number("HOME_POSITION altitude", m.altitude / 1e3, near=0.5, unit="m")
        t.number("HOME_POSITION z", m.z, near=0.15, unit="m")
        t.note("HOME_POSITION approach", finite(m.approach_x, m.approach_y, m.approach_z))
        t.note("HOME_POSITION q", finite(*m.q))
    if m := newest(r, "GPS_GLOBAL_ORIGIN"):
        t.note("GPS_GLOBAL_ORIGIN", f"{m.latitude} {m.longitude}")
        t.number("GPS_GLOBAL_ORIGIN altitude", m.altitude / 1e3, near=0.5, unit="m")
    if m := newest(r, "SYSTEM_TIME"):
        t.note("SYSTEM_TIME knows the date", m.time_unix_usec > 0)
    if m := newest(r, "TIMESYNC"):
        t.note("TIMESYNC tc1", m.tc1)
        t.note("TIMESYNC counts from boot", abs(m.ts1 / 1e9 - r.now) < 1.0)
    modes(r, t)


def modes(r: Rig, t: Transcript) -> None:
    """Record CURRENT_MODE (id 436), which the dialect lacks.

    Its fields: standard mode, custom mode, intended custom mode.
    """
    raw = next((h for h in reversed(r.received) if h.msgid == 436), None)
    if raw is not None:
        custom, intended, standard = struct.unpack("<IIB", bytes(raw.m).ljust(9, b"\0")[:9])
        t.note("CURRENT_MODE", f"standard {standard} custom {custom:#x} intended {intended:#x}")


@case("contents, disarmed", "the contents of each message, disarmed")
def contents_disarmed(r: Rig, t: Transcript) -> None:
    r.clear()
    r.run(5.0)
    contents(r, t)


@case(
    "request message",
    "MAV_CMD_REQUEST_MESSAGE for every message of the link, for other messages and for unknown ones",
)
def request(r: Rig, t: Transcript) -> None:
    wanted = [
        0,
        1,
        2,
        24,
        26,
        27,
        29,
        30,
        31,
        32,
        33,
        36,
        42,
        49,
        62,
        65,
        74,
        77,
        83,
        85,
        87,
        93,
        105,
        111,
        141,
        147,
        148,
        230,
        231,
        241,
        242,
        245,
        259,
        261,
        263,
        264,
        265,
        300,
        331,
        340,
        395,
        411,
        435,
        436,
        9999,
        70000,
    ]
    for msgid in wanted:
        r.command(511, msgid, -1)
        r.run(0.1).clear()
        ack = r.command(512, msgid)
        known = mavlink.mavlink_map.get(msgid)
        name = known.msgname if known else f"id {msgid}"
        t.note(f"{name}: ack", ack)
        t.note(f"{name}: comes", any(h.msgid == msgid for h in r.received))
        r.command(511, msgid, 0)
    for key, p in (("nan", math.nan), ("negative", -5.0), ("infinite", math.inf)):
        t.note(f"{key}: ack", r.command(512, p))


@case("message interval", "MAV_CMD_SET_MESSAGE_INTERVAL and GET_MESSAGE_INTERVAL, with each kind of argument")
def interval(r: Rig, t: Transcript) -> None:
    def hz(seconds: float = 4.0) -> float:
        r.run(0.5).clear()
        r.run(seconds)
        return sum(h.msgid == 30 for h in r.received) / seconds

    for key, us in (
        ("half a second", 500_000.0),
        ("off", -1.0),
        ("back to default", 0.0),
        ("as fast as it goes", 1.0),
        ("default again", 0.0),
    ):
        t.note(f"ATTITUDE {key}: ack", r.command(511, 30, us))
        t.number(f"ATTITUDE {key}", hz(), near=0.6, part=0.1, unit="Hz")
    for key, p in (
        ("unknown message", (9999.0, 1e6)),
        ("nan id", (math.nan, 1e6)),
        ("nan interval", (30.0, math.nan)),
        ("minus two", (30.0, -2.0)),
        ("infinite", (30.0, math.inf)),
        ("id by fraction", (30.4, 100_000.0)),
        ("huge id", (1e9, 1e6)),
    ):
        t.note(f"{key}: ack", r.command(511, *p))
        t.number(f"ATTITUDE after {key}", hz(3.0), near=0.8, part=0.1, unit="Hz")
        r.command(511, 30, 0)
    for msgid in (0, 1, 2, 30, 31, 32, 33, 74, 77, 83, 85, 105, 111, 141, 147, 148, 230, 242, 245, 331, 9999):
        r.clear()
        t.note(f"get {msgid}: ack", r.command(510, msgid))
        found = r.all("MESSAGE_INTERVAL")
        t.number(
            f"get {msgid}: interval", found[-1].interval_us if found else None, near=1.0, part=0.05, unit="us"
        )
    t.note("set by COMMAND_INT: ack", r.command(511, 30, 200_000, way="int"))
    t.number("ATTITUDE set by COMMAND_INT", hz(), near=0.6, unit="Hz")
    r.command(511, 30, 0)
    t.note("set on a message not of the link: ack", r.command(511, 83, 100_000))


@case("timesync and ping", "the replies to TIMESYNC and PING")
def protocols(r: Rig, t: Transcript) -> None:
    r.clear()
    r.send(mavlink.MAVLink_timesync_message(0, 123456789))
    r.run(0.5)
    answers = [m for m in r.all("TIMESYNC") if m.tc1]
    t.note("TIMESYNC answered", bool(answers))
    if answers:
        t.note("TIMESYNC ts1 returned", answers[-1].ts1 == 123456789)
        t.note("TIMESYNC tc1 is its time since boot", abs(answers[-1].tc1 / 1e9 - r.now) < 2.0)
    for key, target in (("to all", (0, 0)), ("to it", (r.id, 1)), ("to another", (7, 1))):
        r.clear()
        r.send(mavlink.MAVLink_ping_message(5, 77, *target))
        r.run(0.5)
        found = [m for m in r.all("PING") if m.seq == 77]
        t.note(f"PING {key} answered", bool(found))
        if found:
            t.note(
                f"PING {key} answer's target",
                f"{found[-1].target_system == r.id} {found[-1].target_component}",
            )


@case(
    "gps origin",
    "SET_GPS_GLOBAL_ORIGIN without an origin: what becomes valid",
    setup=Setup(origin=False),
    ground=False,
)
def origin(r: Rig, t: Transcript) -> None:
    for key in ("before", "after"):
        r.clear()
        r.run(5.0)
        for name in ("GPS_GLOBAL_ORIGIN", "GLOBAL_POSITION_INT", "HOME_POSITION", "LOCAL_POSITION_NED"):
            t.note(f"{key}: {name} comes", bool(r.all(name)))
        t.note(f"{key}: may arm", r.may_arm)
        if key == "before":
            r.clear()
            r.send(mavlink.MAVLink_set_gps_global_origin_message(r.id, 387_000_000, -91_000_000, 100_000, 0))
            r.run(1.0)
            found = r.all("GPS_GLOBAL_ORIGIN")
            t.note("echoed", bool(found))
    found = r.all("GPS_GLOBAL_ORIGIN")
    t.note("GPS_GLOBAL_ORIGIN", f"{found[-1].latitude} {found[-1].longitude}" if found else "nothing")
    if m := newest(r, "GLOBAL_POSITION_INT"):
        t.number("lat", m.lat * 1e-7, near=1e-4, unit="deg")
        t.number("alt", m.alt / 1e3, near=0.6, unit="m")
    for key, place in (
        ("out of range", (2_000_000_000, 0, 0)),
        ("again, elsewhere", (400_000_000, -91_000_000, 50_000)),
    ):
        r.clear()
        r.send(mavlink.MAVLink_set_gps_global_origin_message(r.id, *place, 0))
        r.run(3.0)
        found = r.all("GPS_GLOBAL_ORIGIN")
        t.note(
            f"{key}: GPS_GLOBAL_ORIGIN", f"{found[-1].latitude} {found[-1].longitude}" if found else "nothing"
        )
