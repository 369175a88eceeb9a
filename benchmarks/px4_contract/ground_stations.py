"""Cases of the requests that ground stations and SDKs make: files, logs, parameter hash, motor tests, calibration."""

from __future__ import annotations

import math
import re
import struct
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.px4_messages import px4_crc32
from px4_contract.flying import hover, state
from px4_contract.registry import case
from px4_contract.rig import Rig
from px4_contract.transcript import Transcript

NAN = math.nan
_HEAD = struct.Struct("<HBBBBBBI")
_ACK = 128
# PX4's hash leaves out parameters that change by themselves (@volatile).
_VOLATILE = re.compile(
    r"ASPD_SCALE_\d|COM_FLIGHT_UUID|COM_MODE\d_HASH|EKF2_MAG_DECL|LND_FLIGHT_T_(HI|LO)|SENS_DPRES_OFF"
    r"|CAL_(ACC|GYRO|MAG|BARO)\d_([XYZ](OFF|SCALE|COMP|ODIAG)|OFF)"
)


def listed(r: Rig) -> dict[str, Any]:
    """Return the newest PARAM_VALUE of each parameter after PARAM_REQUEST_LIST."""
    r.clear()
    r.send(mavlink.MAVLink_param_request_list_message(r.id, 1))
    r.until(lambda r: r.all("PARAM_VALUE"), 2.0)
    before = -1
    while before != len(r.all("PARAM_VALUE")):
        before = len(r.all("PARAM_VALUE"))
        r.run(2.0)
    return {m.param_id: m for m in r.all("PARAM_VALUE")}


def computed_hash(values: dict[str, Any]) -> int:
    crc = 0
    for name in sorted(values):
        if name == "_HASH_CHECK" or _VOLATILE.fullmatch(name):
            continue
        value = struct.pack("<f", values[name].param_value)  # an integer has the same bytes
        crc = px4_crc32(name.encode() + value, crc)
    return crc


def reported_hash(values: dict[str, Any]) -> int:
    return int(struct.unpack("<I", struct.pack("<f", values["_HASH_CHECK"].param_value))[0])


@case(
    "parameter hash",
    "_HASH_CHECK: the checksum that clients compute from the list, before and after a change",
)
def parameter_hash(r: Rig, t: Transcript) -> None:
    values = listed(r)
    before = reported_hash(values)
    t.note("hash of the list", computed_hash(values) == before)
    r.send(mavlink.MAVLink_param_set_message(r.id, 1, b"MPC_XY_P", 1.05, mavlink.MAV_PARAM_TYPE_REAL32))
    r.run(1.0)
    values = listed(r)
    t.note("after a change: another hash", reported_hash(values) != before)
    t.note("after a change: hash of the list", computed_hash(values) == reported_hash(values))
    r.send(mavlink.MAVLink_param_set_message(r.id, 1, b"MPC_XY_P", 0.95, mavlink.MAV_PARAM_TYPE_REAL32))
    r.run(1.0)
    t.note("changed back: the hash before", reported_hash(listed(r)) == before)


# -- files ---------------------------------------------------------------------------------------------------------------------


class Ftp:
    """FTP client. `ask` returns the reply in words, and keeps its data and offset."""

    def __init__(self, r: Rig) -> None:
        self.r, self.seq, self.data = r, 100, b""

    def send(
        self, operation: int, data: bytes = b"", offset: int = 0, size: int | None = None, to: Any = None
    ) -> None:
        self.seq += 2
        head = _HEAD.pack(self.seq, 0, operation, len(data) if size is None else size, 0, 0, 0, offset)
        system, component = to or (self.r.id, 1)
        self.r.clear()
        self.r.send(
            mavlink.MAVLink_file_transfer_protocol_message(
                0, system, component, (head + data).ljust(251, b"\0")
            )
        )

    def replies(self) -> list[tuple[int, int, bytes]]:
        """Return (operation, offset, data) of each reply since the last request."""
        found = []
        for m in self.r.all("FILE_TRANSFER_PROTOCOL"):
            raw = bytes(m.payload)
            _, _, operation, size, _, _, _, offset = _HEAD.unpack_from(raw)
            found.append((operation, offset, raw[_HEAD.size : _HEAD.size + size]))
        return found

    def ask(
        self, operation: int, data: bytes = b"", offset: int = 0, size: int | None = None, to: Any = None
    ) -> str:
        self.send(operation, data, offset, size, to)
        self.r.until(lambda r: r.all("FILE_TRANSFER_PROTOCOL"), 1.0)
        found = self.replies()
        if not found:
            return "silence"
        kind, _, self.data = found[0]
        return "ack" if kind == _ACK else f"nak {self.data[0]}"


def metadata(r: Rig, msgid: int) -> tuple[str, str, int]:
    """Return the acknowledgement of the request for COMPONENT_METADATA or COMPONENT_INFORMATION, the URI in it, and the checksum."""
    r.clear()
    ack = r.command(512, msgid)
    raw = next((bytes(h.m) for h in r.received if h.msgid == msgid), b"").ljust(212, b"\0")
    skip = 8 if msgid == 397 else 12
    return ack, raw[skip : skip + 100].split(b"\0")[0].decode(), struct.unpack_from("<I", raw, 4)[0]


@case(
    "files",
    "MAVLink FTP: the files of the component metadata, missing files, and requests that are not understood",
)
def files(r: Rig, t: Transcript) -> None:
    for name, msgid in (("COMPONENT_METADATA", 397), ("COMPONENT_INFORMATION", 395)):
        ack, uri, crc = metadata(r, msgid)
        t.note(f"{name}: ack", ack)
        t.note(f"{name}: over FTP", uri.startswith("mftp://etc/extras/component_general.json"))
    ftp, path = Ftp(r), uri.removeprefix("mftp://").encode()
    t.note("reset", ftp.ask(2))
    t.note("nothing", ftp.ask(0))
    t.note("terminate without a session", ftp.ask(1))
    t.note("open a missing file", ftp.ask(4, b"/no/such/file"))
    t.note("open the parameters of ArduPilot", ftp.ask(4, b"@PARAM/param.pck"))
    t.note("list a missing folder", ftp.ask(3, b"/no/such/folder"))
    t.note("list the root", ftp.ask(3, b"/"))
    t.note("the root has etc", b"Detc" in ftp.data or b"Dlog" in ftp.data)
    t.note("list beyond the end", ftp.ask(3, b"/", offset=5000))
    t.note("unknown operation", ftp.ask(77))
    t.note("read without a file", ftp.ask(5, size=100))
    t.note("checksum", ftp.ask(14, path))
    t.note("checksum as announced", ftp.data == struct.pack("<I", crc))
    t.note("open", ftp.ask(4, path))
    size = struct.unpack("<I", ftp.data.ljust(4, b"\0")[:4])[0]
    t.note("size is known", size > 0)
    t.note("open another", ftp.ask(4, path))
    content = b""
    while len(content) < size and ftp.ask(5, offset=len(content), size=200) == "ack" and ftp.data:
        content += ftp.data
    t.note("read whole", len(content) == size)
    t.note("checksum of the content", px4_crc32(content) == crc)
    t.note("read beyond the end", ftp.ask(5, offset=size + 10, size=100))
    ftp.send(15, offset=0, size=239)
    r.run(2.0)
    parts = [p for p in ftp.replies() if p[0] == _ACK]
    t.note(
        "burst is the content", b"".join(data for _, _, data in sorted(parts, key=lambda p: p[1])) == content
    )
    ftp.seq += 1000  # PX4 counts the messages of the burst, too
    t.note("burst ends with", f"nak {ftp.replies()[-1][2][0]}" if ftp.replies() else "silence")
    t.note("terminate", ftp.ask(1))
    t.note("for everybody", ftp.ask(2, to=(0, 0)))
    t.note("for another vehicle", ftp.ask(2, to=(7, 1)))
    t.note("for the camera", ftp.ask(2, to=(r.id, 100)))


@case(
    "logs", "LOG_REQUEST_LIST and LOG_REQUEST_DATA after a flight that was armed and disarmed", ground=False
)
def logs(r: Rig, t: Transcript) -> None:
    t.note("arm", r.arm())
    r.run(3.0)
    t.note("disarm", r.disarm())
    r.run(5.0)
    r.clear()
    r.send(mavlink.MAVLink_log_request_list_message(r.id, 1, 0, 0xFFFF))
    r.run(2.0)
    entries = r.all("LOG_ENTRY")
    t.note("one entry for each log", len(entries) == (entries[0].num_logs if entries else -1))
    if not entries:
        return
    m = entries[-1]
    t.note("numbered from 0", m.id == m.num_logs - 1)
    t.note("last_log_num", m.last_log_num == m.num_logs - 1)
    t.note("has a size", m.size > 1000)
    t.note("has a date", m.time_utc > 1_000_000_000)
    for key, log, at, count in (
        ("begin", m.id, 0, 400),
        ("middle", m.id, 500, 90),
        ("no such log", 99, 0, 90),
    ):
        r.clear()
        r.send(mavlink.MAVLink_log_request_data_message(r.id, 1, log, at, count))
        r.run(1.5)
        parts = r.all("LOG_DATA")
        t.note(f"{key}: bytes", sum(p.count for p in parts) >= count if parts else "silence")
        if key == "begin" and parts:
            t.note("is a ULog", bytes(parts[0].data[:4]) == b"ULog")
    r.send(mavlink.MAVLink_log_request_end_message(r.id, 1))
    r.clear()
    r.send(mavlink.MAVLink_log_request_list_message(7, 1, 0, 0xFFFF))
    r.run(1.0)
    t.note("for another vehicle", bool(r.all("LOG_ENTRY")))


# -- commands --------------------------------------------------------------------------------------------------------------------


@case("motor test", "MAV_CMD_ACTUATOR_TEST of motors, servos and unknown outputs, disarmed and armed")
def motor_test(r: Rig, t: Transcript) -> None:
    for name, p in (
        ("motor 1", (0.1, 1, 0, 0, 1)),
        ("motor 1 stops", (NAN, 0, 0, 0, 1)),
        ("motor 12", (0.1, 1, 0, 0, 12)),
        ("servo 1", (0.1, 1, 0, 0, 33)),
        ("output 0", (0.1, 1, 0, 0, 0)),
        ("output 20", (0.1, 1, 0, 0, 20)),
        ("motor 1 by function", (0.1, 1, 0, 0, 1101)),
        ("motor 1 by function stops", (NAN, 0, 0, 0, 1101)),
    ):
        t.note(name, r.command(310, *p))
        r.run(0.3)
    r.run(3.5)
    t.note("armed: arm", r.arm())
    t.note("armed: motor 1", r.command(310, 0.1, 1, 0, 0, 1))
    r.disarm()
    t.note("not moved", bool(abs(r.p_n[2] + 0.05) < 0.1))


@case(
    "calibration",
    "MAV_CMD_PREFLIGHT_CALIBRATION: the end of a calibration, and a calibration of an armed vehicle",
)
def calibration(r: Rig, t: Transcript) -> None:
    t.note("end", r.command(241))
    r.arm()
    for name, p in (
        ("gyro", (1,)),
        ("accelerometer", (0, 0, 0, 0, 1)),
        ("level", (0, 0, 0, 0, 2)),
        ("end", ()),
    ):
        t.note(f"armed: {name}", r.command(241, *p))
    r.disarm()


@case("calibration of a sensor", "MAV_CMD_PREFLIGHT_CALIBRATION of the gyro, disarmed", ground=False)
def calibration_of_a_sensor(r: Rig, t: Transcript) -> None:
    r.clear()
    t.note("ack", r.command(241, 1))
    r.run(8.0)
    texts = [x for _, x in r.texts()]
    t.note("has texts for ground stations", any(x.startswith("[cal]") for x in texts))
    t.words("texts", "; ".join(texts))


@case("flight information", "FLIGHT_INFORMATION disarmed and armed, MAV_CMD_REQUEST_FLIGHT_INFORMATION")
def flight_information(r: Rig, t: Transcript) -> None:
    for key in ("disarmed", "armed"):
        if key == "armed":
            r.arm()
            r.run(1.0)
        r.clear()
        t.note(f"{key}: ack", r.command(512, 264))
        found = r.all("FLIGHT_INFORMATION")
        if found:
            m = found[-1]
            t.note(f"{key}: arming time known", m.arming_time_utc > 0)
            t.note(f"{key}: take-off time known", m.takeoff_time_utc > 0)
    r.disarm()
    r.clear()
    t.note("deprecated command", r.command(528, 1))
    t.note("deprecated command: comes", bool(r.all("FLIGHT_INFORMATION")))


@case("mission item selected by a command", "MAV_CMD_DO_SET_MISSION_CURRENT without a mission, disarmed")
def mission_current(r: Rig, t: Transcript) -> None:
    for name, p in (("first", (0, 0)), ("beyond", (7, 0)), ("nan", (NAN, 0))):
        t.note(name, r.command(224, *p))
    t.note("state after", state(r))


@case(
    "position target",
    "POSITION_TARGET_GLOBAL_INT and NAV_CONTROLLER_OUTPUT in HOLD and on a reposition",
    ground=False,
)
def position_target(r: Rig, t: Transcript) -> None:
    hover(r)
    r.set_mode(4, 3)
    r.each.clear()
    r.run(2.0).clear()
    r.run(4.0)
    found = r.all("POSITION_TARGET_GLOBAL_INT")
    t.number("HOLD: rate", len(found) / 4.0, near=0.8, part=0.1, unit="Hz")
    if found:
        t.note("HOLD: frame", found[-1].coordinate_frame)
        here = r.state["GLOBAL_POSITION_INT"]
        t.number(
            "HOLD: latitude off the position", (found[-1].lat_int - here.lat) * 1e-7, near=1e-5, unit="deg"
        )
        t.number("HOLD: altitude off the position", found[-1].alt - here.alt / 1e3, near=0.5, unit="m")
    t.note("HOLD: NAV_CONTROLLER_OUTPUT", bool(r.all("NAV_CONTROLLER_OUTPUT")))
