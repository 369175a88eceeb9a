"""Hostile MAVLink for every core that reads it: none raises, and what it sends is valid."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest
from pymavlink.dialects.v20 import common as mavlink

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER))

from fuzzing import KINDS, Fuzz, read  # noqa: E402

from arena.emergency.landing_sequence import LandingSequence  # noqa: E402
from arena.fcu_link.core import FcuLink  # noqa: E402
from arena.fcu_link.settings import Settings  # noqa: E402
from arena.mavlink_router.router import Router  # noqa: E402
from arena.mavlink_router.routing_table import Table  # noqa: E402
from arena.pose_forwarder.forwarder import Forwarder  # noqa: E402
from arena.wire.mavlink_codec import Codec  # noqa: E402
from arena.wire.mavlink_frame import parse_frames  # noqa: E402
from arena.wire.telemetry import Telemetry  # noqa: E402

MESSAGES, STEP_S = 3000, 0.004


def hostile_frames(system: int, *, own: float = 0.8, seed: int = 5) -> Iterator[tuple[bytes, float]]:
    """Yield (frame, now [s]): random messages of the dialect, most of them from the autopilot."""
    rng = Random(seed)
    fuzz = Fuzz(rng, system)
    other = fuzz.speaker
    fuzz.speaker = lambda: (system, 1) if rng.random() < own else other()  # type: ignore[method-assign]
    for k in range(MESSAGES):
        yield fuzz.frame(rng.choice(list(KINDS))), 10.0 + k * STEP_S


def test_the_forwarder_sends_only_heartbeats_without_poses():
    settings = {
        "name": "forward.uav1",
        "vehicle": "uav1",
        "id": 3,
        "body": "a",
        "frame_rate_hz": 180,
        "rate_hz": 60,
        "stale_s": 0.1,
        "noise": {"position_m": 0.001, "rotation_deg": 0.5},
        "origin": {"lat_deg": 38.7, "lon_deg": -9.1, "alt_m": 100.0},
    }
    forwarder = Forwarder(settings)
    for data, now in hostile_frames(3):
        forwarder.on_mavlink(data, now)
        for sent in forwarder.tick(now):
            m = read(sent)
            assert m.get_type() == "HEARTBEAT" or m.command == mavlink.MAV_CMD_REQUEST_MESSAGE
    assert forwarder.poses == 0 and forwarder.autopilot.last_heartbeat > 0


@pytest.mark.parametrize("who", ["autopilot", "program", "gcs"])
def test_the_router_passes_whole_frames_to_named_vehicles_only(who):
    host = "127.22.0.1"
    vehicles = [
        {
            "name": f"uav{k}",
            "id": k,
            "link": {"local": [host, 1000 + k], "remote": [host, 2000 + k]},
            "serve": [host, 3000 + k],
            "clients": [{"name": "program", "address": [host, 4000 + k]}],
            "tools": [host, 6000 + k],
        }
        for k in (1, 2)
    ]
    table = Table.from_slice(
        {
            "name": "router",
            "vehicles": vehicles,
            "gcs_local": [host, 7000],
            "gcs": [{"name": "gcs", "address": [host, 7001]}],
            "heartbeat": True,
            "simulated": True,
        }
    )
    router = Router(table)
    at, sender = {"autopilot": (1001, 2001), "program": (3001, 4001), "gcs": (7000, 7001)}[who]
    for data, now in hostile_frames(1, own=0.8 if who == "autopilot" else 0.0):
        frame = parse_frames(data).frames[0]
        for piece, destinations in router.on_datagram(
            router.sockets.index((host, at)), (host, sender), data, now
        ):
            assert parse_frames(bytes(piece)).garbage == 0
            to = {address[1] for _, address in destinations} & {2001, 2002}
            assert who == "gcs" or 2002 not in to
            assert not to or frame.target_sys in (0, *(port - 2000 for port in to))
        router.tick(now)


def test_telemetry_of_a_program_survives_hostile_frames():
    telemetry = Telemetry(1)
    for data, now in hostile_frames(1):
        telemetry.on_datagram(data, now)
    assert telemetry.heartbeat is not None


def test_the_link_arms_no_vehicle_on_hostile_frames():
    ends = {
        n: {"local": ["127.22.0.1", 24000 + 2 * i], "remote": ["127.22.0.1", 24001 + 2 * i]}
        for i, n in enumerate(("router", "vision", "panic"))
    }
    preflight = {
        "position_m": 0.2,
        "yaw_deg": 15.0,
        "tilt_deg": 10.0,
        "imu": False,
        "pose_age_s": 0.1,
        "pose_rate_hz": 50.0,
        "battery": 0.2,
        "size_m": [7, 4, 3],
        "height_m": 0.1,
        "poses": True,
        "radio": None,
        "axes_check": False,
    }
    link = FcuLink(
        Settings.from_slice(
            {
                "name": "link.uav7",
                "vehicle": "uav7",
                "id": 7,
                "uid": "",
                "wire": {"kind": "udpin", "address": ["127.22.0.1", 14540]},
                "links": ends,
                "simulator": None,
                "preflight": preflight,
                "params": {},
                "missing_reboots": {"folder": "/nowhere", "address": ""},
                "params_file": "",
                "simulated": False,
                "body": "uav7",
                "capture": None,
            }
        ),
        0.0,
    )
    rng, arming = Random(3), Fuzz(Random(1), 7).command(400, 1.0)
    nothing = [0] * 8
    version = mavlink.MAVLink_autopilot_version_message(0, 0, 0, 0, 0, nothing, nothing, nothing, 0, 0, 1)
    uid = Codec(7, 1).pack(version)
    for data, now in hostile_frames(7):
        link.from_vehicle(uid, parse_frames(uid), now)
        link.from_vehicle(data, parse_frames(data), now)
        for end in ("router", "vision", "panic"):
            link.from_link(end, data if rng.random() < 0.9 else arming, now)
        link.tick(now)
        while (frame := link.next_out(now)) is not None:
            assert len(parse_frames(frame).frames) == 1
            assert link.checks.armed or frame != arming
        assert all(isinstance(words, str) for words in link.reasons(now))


@pytest.mark.parametrize("action", ["land", "kill"])
def test_a_landing_continues_on_hostile_frames(action):
    landing = LandingSequence(name="uav1", system=1, component=200, action=action, now=10.0)
    for data, now in hostile_frames(1):
        landing.on_datagram(data, now)
        for said in landing.due(now):
            m = read(said)
            assert m.get_type() != "COMMAND_LONG" or all(
                math.isfinite(getattr(m, f"param{k}")) for k in (1, 2)
            )
        assert landing.result_line(now)
