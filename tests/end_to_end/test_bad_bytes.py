"""Test that random bytes, incomplete frames and a flood at every port are counted and do not disturb a flight.

Valid commands are executed, as PX4 does; none is sent here.
"""

from __future__ import annotations

import random
import socket
import struct
import time
from collections.abc import Iterator

import psutil
import pytest
from pymavlink.dialects.v20 import common as mavlink

from .flight import Flight, Hangar

pytestmark = pytest.mark.flight
VEHICLES = {"uav1": "tours", "uav2": "tours"}
FLOOD, FLOOD_PER_S = 21_000, 7000
GROWTH_MB = 6.0


def bad_datagrams(rng: random.Random) -> Iterator[bytes]:
    """Return bytes that are never a complete valid frame with an effect."""
    voice = mavlink.MAVLink(None, srcSystem=77, srcComponent=77)
    whole = mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, *[0.0] * 7
    ).pack(voice)
    while True:
        yield rng.randbytes(rng.randrange(0, 300))
        yield whole[: rng.randrange(1, len(whole) - 1)]  # half a frame
        yield whole[:-2] + bytes(2)  # a wrong checksum
        yield b"\xfd\xff\x00\x00" + rng.randbytes(600)  # the longest payload announced, and more behind it
        yield b"\xfd" * rng.randrange(1, 64)  # nothing but beginnings
        yield rng.randbytes(60_000)  # a datagram as long as they get


def bad_questions(rng: random.Random) -> Iterator[bytes]:
    """Return NatNet requests with wrong lengths, unknown numbers, or no content."""
    while True:
        yield rng.randbytes(rng.randrange(0, 200))
        yield struct.pack("<HH", rng.choice([0, 2, 4, 5, 0xFFFF]), 0xFFFF) + rng.randbytes(8)
        yield struct.pack("<HH", rng.randrange(50, 60_000), rng.randrange(12)) + rng.randbytes(
            8
        )  # shorter than it says


def ports(flight: Flight) -> dict[str, list[int]]:
    """Return process name -> its UDP ports."""
    found: dict[str, list[int]] = {}
    for name, slice_ in (
        (name, flight.json(f"slices/{name}.json")) for name in ("world", "router", "mocap", "recorder")
    ):
        match name:
            case "world":
                found[name] = [link["local"][1] for v in slice_["vehicles"] for link in v["links"].values()]
            case "router":
                own = [(v["link"]["local"][1], v["serve"][1], v["tools"][1]) for v in slice_["vehicles"]]
                found[name] = [slice_["gcs_local"][1], *(port for each in own for port in each)]
            case "recorder":
                found[name] = [slice_["listen"][1]]
            case "mocap":
                found[name] = [slice_["command_port"]]
    for vehicle in VEHICLES:
        for room in ("forward", "program"):
            slice_ = flight.json(f"slices/{room}.{vehicle}.json")
            port = slice_["link"]["local"][1] if room == "forward" else int(slice_["link"].rpartition(":")[2])
            found[f"{room}.{vehicle}"] = [port]
    return found


def throw(flight: Flight, where: dict[str, list[int]], rng: random.Random) -> int:
    """Send one of each kind to every port, then a flood to all; return the number of datagrams."""
    bad, questions, sent = bad_datagrams(rng), bad_questions(rng), 0
    targets = [(name, port) for name, some in where.items() for port in some]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind((flight.address, 0))
        for name, port in targets:
            for _ in range(24):
                s.sendto(next(questions if name == "mocap" else bad), (flight.address, port))
                sent += 1
        some = [next(bad) for _ in range(600)]
        few = [x for x in some if len(x) < 1000]
        began, floods = time.monotonic(), 0
        while floods < FLOOD:
            for _ in range(min(FLOOD, int((time.monotonic() - began) * FLOOD_PER_S)) - floods):
                name, port = targets[floods % len(targets)]
                s.sendto(
                    next(questions) if name == "mocap" else few[floods % len(few)], (flight.address, port)
                )
                floods += 1
            time.sleep(0.002)  # not a wait for anything: the pace of the flood
    return sent + floods


def resident_mb(flight: Flight) -> dict[str, float]:
    return {name: psutil.Process(m.pid).memory_info().rss / 1e6 for name, m in flight.state.processes.items()}


def test_garbage_on_any_port_does_not_disturb_a_flight(hangar: Hangar) -> None:
    flight = hangar.fly(VEHICLES, "--until-done", "--time-limit", "90")
    flight.until_up(0.9)
    where, before = ports(flight), resident_mb(flight)
    sent = throw(flight, where, random.Random(1))
    after = resident_mb(flight)
    grown = {name: round(after[name] - mb, 1) for name, mb in before.items()}
    print(f"{sent} datagrams at {sum(map(len, where.values()))} ports; grown by [MB]: {grown}")

    assert flight.wait(90) == 0, flight.said()
    assert max(grown.values()) < GROWTH_MB
    summary = flight.summary
    for vehicle in VEHICLES:
        told = summary["vehicles"][vehicle]
        assert told["setpoints"]["count"] == 4 and told["setpoints"]["worst_m"] <= 0.10, told["setpoints"]
        assert told["landing"]["error_m"] <= 0.3 and told["crashed"] == ""
    stats = {name: row["stats"] for name, row in summary["processes"].items()}
    assert all(row["starts"] == 1 for row in summary["processes"].values())

    print({name: own.get("dropped") or own for name, own in stats.items()})
    dropped = stats["router"]["dropped"]
    assert (
        dropped["unknown sender on a client socket"] > 100
        and dropped["unknown sender on the ground stations' socket"] > 50
    )
    assert dropped["garbage bytes"] > 10_000 and dropped["wrong CRC"] > 10
    for vehicle in VEHICLES:
        autopilot = stats["world"]["autopilot"][vehicle]
        assert autopilot["garbage bytes"] > 10_000 and autopilot["bad checksum"] > 10
        assert stats[f"forward.{vehicle}"]["dropped foreign datagram"] > 100
    assert stats["recorder"]["unknown_datagrams"] > 100 and stats["recorder"]["lost_datagrams"] == 0
    assert stats["mocap"]["malformed"] > 100 and stats["mocap"]["other message"] > 10
    flight.assert_nothing_left()
