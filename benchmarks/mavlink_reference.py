"""Generator of docs/reference/mavlink.md: what the built-in autopilot sends and answers over MAVLink, beside PX4 v1.16.

    python benchmarks/mavlink_reference.py

The page is made from the tables of the code and from the recorded transcript of PX4. A test makes it again and compares.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from px4_contract.commands import ON_THE_GROUND
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.mavlink import mavlink_interface, mission_protocol, streams
from arena.autopilot.mavlink.command_handlers import COMMANDS
from arena.autopilot.mavlink.file_server import _OPERATIONS, Operation
from arena.wire.mavlink_layout import message_name
from arena.wire.px4_messages import REQUEST_EVENT

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "mavlink.md"
RECORDED = json.loads((ROOT / "benchmarks" / "px4_contract" / "px4-v1.16.json").read_text())
_HEAD = """<!-- written by python benchmarks/mavlink_reference.py; do not edit -->

# MAVLink of the built-in autopilot

- The columns "PX4" were measured with PX4 v1.16 SITL in an arena with motion capture, disarmed on the floor (`benchmarks/contract.py`).
- A message or command for another system or component is ignored.
- Tested with MAVSDK-Python 4.1 and MAVProxy 1.8. QGroundControl itself was not tested; cases of the contract send the same requests.

## Messages that are sent

The autopilot has two links to the router, as PX4 has MAVLink instances. The first two columns of rates are those of the link for
programs, SDKs and tools (PX4's mode ONBOARD), the other two those of the link for ground stations (PX4's mode NORMAL).
`MAV_CMD_SET_MESSAGE_INTERVAL` changes the rates of the link on which it arrives, and `MAV_CMD_REQUEST_MESSAGE` sends each of these
messages once. "Event": the message is sent when there is something to report.

`WIND_COV` is not in the table: the built-in autopilot estimates no wind, so a request for this message is denied. PX4 sends it only while
it estimates the wind (`EKF2_DRAG_CTRL` 1).

"""
_EVENTS = {
    "COMMAND_ACK": "reply to each command",
    "STATUSTEXT": "texts for people, to links with a ground station",
    "PARAM_VALUE": "reply to a parameter request",
    "MISSION_CURRENT": "once a second, and when the item changes",
    "MISSION_ITEM_REACHED": "an item of the mission is reached",
    "FILE_TRANSFER_PROTOCOL": "reply to FTP",
    "LOG_ENTRY": "reply to LOG_REQUEST_LIST",
    "LOG_DATA": "reply to LOG_REQUEST_DATA",
    "EVENT": "what the autopilot decides: arming, modes, failsafes, missions, take-off, landing",
    "RESPONSE_EVENT_ERROR": "reply to REQUEST_EVENT: the event is not available",
    "MESSAGE_INTERVAL": "reply to MAV_CMD_GET_MESSAGE_INTERVAL",
}
_WHEN = {
    "PING": "also the reply to a PING",
    "TIMESYNC": "also the reply to a TIMESYNC",
    "RC_CHANNELS": "while a radio is on",
    "GPS_RAW_INT": "the estimated position, with an origin; satellites are unknown (255)",
    "GLOBAL_POSITION_INT": "with an origin",
    "HOME_POSITION": "with an origin",
    "GPS_GLOBAL_ORIGIN": "with an origin; also the reply to SET_GPS_GLOBAL_ORIGIN",
    "POSITION_TARGET_GLOBAL_INT": "armed, in AUTO modes, with an origin",
    "NAV_CONTROLLER_OUTPUT": "in a mission, a return or a reposition. PX4 sends it for planes and rovers",
    "ORBIT_EXECUTION_STATUS": "in an orbit",
    "VIBRATION": "zeros: the simulated rotors do not vibrate",
    "ESC_STATUS": "speeds are 6000/min times the motor command, as in PX4 SITL",
    "CURRENT_EVENT_SEQUENCE": "the number of the newest event",
    "SYSTEM_TIME": "the date is that of the computer at speed 1, else 1 January 2026 at the start, so that flights are repeatable",
    "COMPONENT_METADATA": "names files that MAVLink FTP reads: types, defaults and ranges of the parameters, texts of the events",
}
_RECEIVED = {
    "ODOMETRY": "external vision",
    "VISION_POSITION_ESTIMATE": "external vision",
    "SET_POSITION_TARGET_LOCAL_NED": "offboard setpoint",
    "SET_POSITION_TARGET_GLOBAL_INT": "offboard setpoint",
    "SET_ATTITUDE_TARGET": "offboard setpoint",
    "HEARTBEAT": "of a ground station: the data link",
    "SET_GPS_GLOBAL_ORIGIN": "origin of the local frame, disarmed only",
    "LOG_ERASE": "ignored: the logs belong to the run folder",
    "REQUEST_EVENT": "the 20 newest events are sent again; RESPONSE_EVENT_ERROR for others",
    "SET_MODE": "as MAV_CMD_DO_SET_MODE",
    "TIMESYNC": "answered",
    "PING": "answered",
    "RC_CHANNELS_OVERRIDE": "sticks of a radio",
    "MANUAL_CONTROL": "sticks of a joystick",
}
_COMMAND_NOTES = {
    "MAV_CMD_DO_ORBIT": "flown in AUTO.LOITER; PX4 has the mode ORBIT. Refused across the geofence",
    "MAV_CMD_PREFLIGHT_CALIBRATION": "refused with `[cal] calibration failed`; armed: temporarily rejected, as in PX4",
    "MAV_CMD_ACTUATOR_TEST": "motors only, disarmed only, at most 3 s",
    "MAV_CMD_DO_SET_MISSION_CURRENT": "PX4 supports only the message MISSION_SET_CURRENT",
    "MAV_CMD_DO_REPOSITION": "with the flag to change the mode",
    "MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN": "the estimator restarts; PX4 SITL cannot reboot",
    "MAV_CMD_INJECT_FAILURE": "with SYS_FAILURE_EN",
}
_SENT_HEAD = ("message", "id", "rate [Hz]", "PX4 [Hz]", "ground stations [Hz]", "PX4 [Hz]", "notes")
_PROTOCOLS = """## Protocols

| protocol | built-in | PX4 v1.16 |
| --- | --- | --- |
| parameters | list, read, write; `_HASH_CHECK` as in PX4, for the caches of ground stations | the same |
| missions, geofences, rally points | upload, download, clear, progress | the same |
| FTP | list, read, burst, checksum: `/etc/extras` (metadata), `/log` (ULogs); no writing; a session per client | one session, also writes |
| parameters over FTP (`@PARAM/param.pck`) | file not found, as in PX4; clients then request the list | file not found |
| logs (`LOG_REQUEST_LIST`, `LOG_REQUEST_DATA`) | list, download; one empty entry without logs | silence without logs |
| component metadata | parameters, events | parameters, events, actuators |
| events | PX4's events for arming, modes, failsafes, missions, take-off and landing; no arming-check reports | the same, and more |
| time (`TIMESYNC`), `PING` | answered | the same |
"""


def main() -> None:
    """Write the page."""
    PAGE.write_text(page())


def page() -> str:
    """Return the text of the page."""
    ftp = ", ".join(o.name for o in Operation if o in _OPERATIONS)
    return "\n".join(
        [
            _HEAD + table(_SENT_HEAD, sent()),
            "## Messages that are received\n",
            table(("message", "meaning"), received()),
            "## Commands\n\nOther commands are acknowledged as UNSUPPORTED. Results of PX4: one per tested argument, in order.\n",
            table(("command", "number", "built-in", "PX4, disarmed", "notes"), commands()),
            _PROTOCOLS,
            f"Operations of FTP: {ftp}.\n",
        ]
    )


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    head = list(head)
    return "\n".join("| " + " | ".join(row) + " |" for row in ([*head], ["---"] * len(head), *rows)) + "\n"


def sent() -> list[list[str]]:
    """Return the rows of the messages that are sent, by name."""
    rows = {
        message_name(msgid): _sent_row(msgid)
        for msgid in streams.SUPPORTED
        if message_name(msgid) not in _EVENTS
    }
    numbers = {m.msgname: n for n, m in mavlink.mavlink_map.items()} | {
        "EVENT": 410,
        "RESPONSE_EVENT_ERROR": 413,
    }
    for name, why in _EVENTS.items():
        px4 = RECORDED["rates, disarmed"].get(f"{name} on router")
        rows[name] = [
            f"`{name}`",
            str(numbers[name]),
            "event",
            f"{px4['value']:.3g}" if px4 else "event",
            "event",
            _px4_ground_rate(name, numbers[name]) or "event",
            why,
        ]
    return [rows[name] for name in sorted(rows)]


def _sent_row(msgid: int) -> list[str]:
    name, hz = message_name(msgid), streams.LINK_RATES["router"].get(msgid, 0.0)
    ground_hz = streams.LINK_RATES[streams.GROUND].get(msgid, 0.0)
    rate, ground_rate = (f"{x:.3g}" if x else "on request" for x in (hz, ground_hz))
    px4, px4_ground = _px4_rate(name, msgid) or "on request", _px4_ground_rate(name, msgid) or "on request"
    return [f"`{name}`", str(msgid), rate, px4, ground_rate, px4_ground, _WHEN.get(name, "")]


def _px4_ground_rate(name: str, msgid: int) -> str:
    """Return PX4's rate of a message on its link for ground stations; "" if it is not streamed there."""
    rates = RECORDED["ground station link, rates"]
    found = next((rates[key] for key in (name, f"id {msgid}") if key in rates), None)
    return f"{found['value']:.3g}" if found else ""


def _px4_rate(name: str, msgid: int) -> str:
    """Return PX4's rate of a message on its router link, "no" if PX4 refused to send it; "" if it sends it on request only."""
    rates, requests = RECORDED["rates, disarmed"], RECORDED["request message"]
    for key in (name, f"id {msgid}"):
        if found := rates.get(f"{key} on router"):
            return f"{found['value']:.3g}"
    acks = [value_of(requests.get(f"{key}: ack")) for key in (name, f"id {msgid}")]
    return "no" if "denied" in acks else ""


def value_of(recorded: Any) -> Any:
    """Return the value of a recorded observation."""
    return recorded["value"] if isinstance(recorded, dict) else recorded


def received() -> list[list[str]]:
    """Return the rows of the messages that are received, by name."""
    known = {
        *mavlink_interface._HANDLERS,
        *mavlink_interface._DECODED_FAST,
        *mission_protocol.MESSAGE_IDS,
        REQUEST_EVENT,
    }
    names = sorted(message_name(msgid) for msgid in known)
    return [[f"`{name}`", _RECEIVED.get(name, _protocol_of(name))] for name in names]


def _protocol_of(name: str) -> str:
    starts = {
        "MISSION": "missions",
        "PARAM": "parameters",
        "LOG": "logs",
        "FILE": "FTP",
        "COMMAND": "commands",
    }
    return next((text for start, text in starts.items() if name.startswith(start)), "")


def commands() -> list[list[str]]:
    """Return the rows of the commands: those that the built-in autopilot supports, and others that PX4 accepts."""
    px4: dict[int, list[str]] = {}
    for name, number, _ in ON_THE_GROUND:
        value = value_of(RECORDED["commands on the ground"].get(f"{name}: ack"))
        if value and value not in px4.setdefault(number, []):
            px4[number].append(value)
    names = {n: e.name for n, e in mavlink.enums["MAV_CMD"].items()}
    accepted = {n for n, acks in px4.items() if {"accepted", "in progress"} & set(acks)}
    rows = []
    for number in sorted((COMMANDS.keys() | accepted) - {0}, key=lambda n: names.get(n, "")):
        name = names.get(number, f"command {number}")
        ours = "supported" if number in COMMANDS else "unsupported"
        theirs = ", ".join(px4.get(number, [])) or "not tried"
        rows.append(
            [f"`{name.removeprefix('MAV_CMD_')}`", str(number), ours, theirs, _COMMAND_NOTES.get(name, "")]
        )
    return rows


if __name__ == "__main__":
    main()
