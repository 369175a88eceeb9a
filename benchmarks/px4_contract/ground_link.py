"""Cases of the link for ground stations: the rates of its streams, and which link carries the answers to its requests."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from px4_contract.flying import come_down, hover
from px4_contract.link import rate
from px4_contract.registry import case
from px4_contract.rig import RESULTS, Received, Rig
from px4_contract.transcript import Transcript

SECONDS = 60.0  # the slowest streams have a period of 10 s
_FTP_LIST = struct.pack("<HBBBBBBI", 1, 0, 3, 1, 0, 0, 0, 0) + b"/"


def rates(r: Rig, t: Transcript) -> None:
    r.station = True
    r.run(3.0).clear()
    r.run(SECONDS)
    for name, count in sorted(r.counted["ground"].items()):
        if name not in ("STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE", "id 410"):
            rate(t, name, count, SECONDS)
    r.station = False


@case("ground station link, rates", "every message of the ground station link with its rate, disarmed")
def rates_disarmed(r: Rig, t: Transcript) -> None:
    rates(r, t)


@case(
    "ground station link, rates in the air",
    "every message of the ground station link with its rate, hovering in OFFBOARD",
    ground=False,
)
def rates_flying(r: Rig, t: Transcript) -> None:
    hover(r)
    rates(r, t)
    come_down(r)


@case(
    "ground station link, silent",
    "the ground station link before a ground station has sent a message",
    ground=False,
)
def silent(r: Rig, t: Transcript) -> None:
    r.clear()
    r.run(5.0)
    t.note("HEARTBEAT", bool(r.counted["ground"]["HEARTBEAT"]))
    t.note("streams", bool(r.counted["ground"]["ATTITUDE"]))


def seen_on(r: Rig, wanted: Callable[[Received], bool]) -> str:
    """Return the links on which a message has arrived since `clear`, each with the number of messages."""
    counts = {"ground": sum(map(wanted, r.on_ground_link)), "router": sum(map(wanted, r.received))}
    return ", ".join(f"{link} {n}" for link, n in counts.items() if n) or "none"


def named(name: str) -> Callable[[Received], bool]:
    return lambda h: h.name == name


def command(r: Rig, number: int, *p: float) -> str:
    """Send a command on the ground station link. Return the acknowledgements and the links on which they have arrived."""
    r.clear()
    r.send(mavlink.MAVLink_command_long_message(r.id, 1, number, 0, *[*p, *[0.0] * 7][:7]), "ground")
    r.run(0.8)

    def answer(h: Received) -> bool:
        return h.name == "COMMAND_ACK" and h.m.command == number

    results = [RESULTS.get(h.m.result, "?") for h in [*r.on_ground_link, *r.received] if answer(h)]
    return f"{' then '.join(results)} on {seen_on(r, answer)}"


def armed_on_ground_link(r: Rig) -> bool:
    """Return the arming state in the newest HEARTBEAT of the ground station link."""
    newest = [h.m for h in r.on_ground_link if h.name == "HEARTBEAT"][-1]
    return bool(newest.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)


def once(r: Rig, message: Any, reply: str, seconds: float = 1.0) -> str:
    r.clear()
    r.send(message, "ground")
    r.run(seconds)
    return seen_on(r, named(reply))


@case("ground station link, commands", "commands of a ground station: one acknowledgement, on its own link")
def commands(r: Rig, t: Transcript) -> None:
    r.station = True
    r.run(1.2)
    t.note("arm", command(r, 400, 1))
    r.settle()
    t.note("armed, by the HEARTBEAT of the router link", r.armed)
    t.note("armed, by the HEARTBEAT of the ground station link", armed_on_ground_link(r))
    t.note("disarm", command(r, 400, 0))
    r.settle()
    t.note("disarmed", not r.armed)
    t.note("unknown command", command(r, 31999))
    r.station = False


@case("ground station link, protocols", "parameters, missions, files and logs requested by a ground station")
def protocols(r: Rig, t: Transcript) -> None:
    r.station = True
    r.run(1.2)
    read = mavlink.MAVLink_param_request_read_message(r.id, 1, b"MPC_XY_P", -1)
    t.note("parameter read", once(r, read, "PARAM_VALUE"))
    for value in (1.05, 0.95):
        change = mavlink.MAVLink_param_set_message(r.id, 1, b"MPC_XY_P", value, 9)
        found = once(r, change, "PARAM_VALUE")
        t.note(f"parameter set to {value}: answered on the ground station link", "ground" in found)
    t.note("mission", once(r, mavlink.MAVLink_mission_request_list_message(r.id, 1, 0), "MISSION_COUNT"))
    request = mavlink.MAVLink_file_transfer_protocol_message(0, r.id, 1, _FTP_LIST.ljust(251, b"\0"))
    t.note("files", once(r, request, "FILE_TRANSFER_PROTOCOL"))
    found = once(r, mavlink.MAVLink_log_request_list_message(r.id, 1, 0, 0xFFFF), "LOG_ENTRY")
    t.note("logs: not on the router link", "router" not in found)
    r.station = False


@case(
    "ground station link, intervals",
    "SET_MESSAGE_INTERVAL and REQUEST_MESSAGE of a ground station change and use its own link only",
)
def intervals(r: Rig, t: Transcript) -> None:
    r.station = True
    r.run(1.2)
    t.note("request AUTOPILOT_VERSION: ack", command(r, 512, 148))
    t.note("request AUTOPILOT_VERSION: comes on", seen_on(r, named("AUTOPILOT_VERSION")))
    for key, us in (("10 Hz", 100_000.0), ("off", -1.0), ("default", 0.0)):
        t.note(f"{key}: ack", command(r, 511, 30, us))
        r.clear()
        r.run(4.0)
        for link in ("ground", "router"):
            rate(t, f"{key}: ATTITUDE on {link}", r.counted[link]["ATTITUDE"], 4.0)
    t.note("get interval: ack", command(r, 510, 30))
    found = [h.m.interval_us for h in r.on_ground_link if h.name == "MESSAGE_INTERVAL"]
    t.number("get interval", found[-1] if found else None, near=1.0, part=0.05, unit="us")
    r.station = False
