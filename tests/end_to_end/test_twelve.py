"""Tests that twelve PX4 vehicles share no port or id and receive no data of each other."""

from __future__ import annotations

import math
import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arena.plan import Plan, make_plan
from arena.schema import load_arena

from .flight import Flight, Hangar, eventually
from .test_px4 import BOTH, GroundStation, px4, px4_process

__all__ = ["px4"]

FIRST = 150 + os.getpid() % 40
NAMES = [f"uav{k}" for k in range(1, 13)]
NEAR_M, NEAR_RAD = 0.1, math.radians(5.0)


def places() -> dict[str, tuple[float, float, float]]:
    """Return name -> north, east [m] and yaw [deg], all different."""
    return {
        name: (1.5 * (i % 4) - 2.25, 1.5 * (i // 4) - 1.5, 15.0 * i - 80.0) for i, name in enumerate(NAMES)
    }


def twelve(folder: Path, address: str = "127.74.12.1") -> Path:
    lines = [f"address: {address}", "world: {size: [8, 6, 3]}", "defaults: {autopilot: px4}", "vehicles:"]
    for k, (name, (n, e, yaw)) in enumerate(places().items()):
        lines.append(
            f"  {name}: {{id: {FIRST + k}, start: {{position: [{n:g}, {e:g}, 0], rpy_deg: [0, 0, {yaw:g}]}}}}"
        )
    file = folder / "arena.yaml"
    file.write_text("\n".join(lines) + "\n")
    return file


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    return make_plan(load_arena(twelve(tmp_path), ["px4.home=stand-in"]))


def test_ports_and_ids_are_unique(plan: Plan) -> None:
    owners = Counter((x.protocol, x.port) for spec in plan.processes for x in spec.listens)
    assert len(owners) > 12 * 8 and set(owners.values()) == {1}
    slices = [plan.slices[f"px4.{name}.json"] for name in NAMES]
    for key in ("instance", "folder", "vehicle"):
        assert len({s[key] for s in slices}) == 12, key
    assert [v.id for v in plan.vehicles] == [FIRST + k for k in range(12)]
    assert len({v.mocap_body for v in plan.vehicles}) == 12
    for s, v in zip(slices, plan.vehicles, strict=True):
        assert f"param set MAV_SYS_ID {v.id}\n" in s["scripts"]["px4-rc.mavlinksim"]


def test_both_ends_of_every_link_match(plan: Plan) -> None:
    """Each end of a link sends to the address that the other end binds."""
    routed = {v["name"]: v for v in plan.slices["router.json"]["vehicles"]}
    ends = []
    for name in NAMES:
        links = plan.slices[f"px4.{name}.json"]["links"]
        for link, partner in (
            (links["vision"], plan.slices[f"forward.{name}.json"]["link"]),
            (links["router"], routed[name]["link"]),
            (links["ground"], routed[name]["ground"]),
        ):
            assert (link["local"], link["remote"]) == (partner["remote"], partner["local"]), name
        ends += [tuple(link[end]) for link in links.values() for end in ("local", "remote")]
        assert (
            plan.slices[f"forward.{name}.json"]["body"]
            == plan.slices[f"forward.{name}.json"]["capture"]["bodies"][0]
            == name
        )
    assert len(set(ends)) == len(ends) == 12 * 8


def position_and_yaw(station: GroundStation, system: int) -> tuple[Any, float] | None:
    place, turned = (station.newest.get((system, kind)) for kind in ("LOCAL_POSITION_NED", "ATTITUDE"))
    return (np.array([place.x, place.y]), turned.yaw) if place is not None and turned is not None else None


def assert_at_home(flight: Flight, station: GroundStation) -> None:
    """Check that each autopilot estimates its own start position; it learns the position from its vision link only."""
    for k, (name, (n, e, yaw)) in enumerate(places().items()):
        found = eventually(
            lambda k=k: position_and_yaw(station, FIRST + k), 10, f"the estimate of {name}", flight.said
        )
        assert np.linalg.norm(found[0] - (n, e)) < NEAR_M, name
        assert abs(math.remainder(found[1] - math.radians(yaw), 2.0 * math.pi)) < NEAR_RAD, name


def assert_loopback_only(flight: Flight) -> None:
    """Check that PX4 opens only the four planned links and the simulator connection."""
    for k, name in enumerate(NAMES):
        sockets = px4_process(flight, name).net_connections("inet")
        links = flight.json(f"slices/px4.{name}.json")["links"]
        assert sorted(c.laddr[1] for c in sockets if not c.raddr) == sorted(
            link["local"][1] for link in links.values()
        ), name
        (world,) = [c.raddr for c in sockets if c.raddr]
        assert tuple(world) == (flight.address, 24009 + 10 * (FIRST + k)), name


def until_recorded(flight: Flight, span_s: float) -> None:
    """Wait until the recorder has recorded this simulated time from now on. The logs are made from the record at the end."""
    until = flight.truth().time_s + span_s
    eventually(lambda: flight.truth().time_s > until, 60, f"{span_s} s of simulated time", flight.said)


def assert_logged_at_home(flight: Flight, name: str) -> None:
    """Check that the log contains the own autopilot and the own body only."""
    rows, (north, east, _) = flight.rows(name), places()[name]
    assert len(rows) > 20, name
    for group in ("mocap.pos", "ekf.pos"):
        seen = np.array([[float(r[f"{group}.{axis}"] or "nan") for axis in ("north", "east")] for r in rows])
        seen = seen[~np.isnan(seen).any(axis=1)]
        seen = seen[-15:] if group == "ekf.pos" else seen  # an estimate begins anywhere
        assert len(seen) > 5 and np.abs(seen - (north, east)).max() < NEAR_M, (name, group)


@pytest.mark.crowd
@pytest.mark.nightly
@pytest.mark.parametrize("px4", BOTH, indirect=True)
def test_twelve_vehicles_do_not_receive_each_others_messages(hangar: Hangar, px4: list[str]) -> None:
    station = GroundStation(hangar.address, replies=True)
    flight = hangar.up(twelve(hangar.folder, hangar.address), "--time-limit", "150", *px4)
    try:
        for name in NAMES:
            flight.until_event(f"forward.{name}", "READY", 120)  # it serves an autopilot that may arm
        assert_at_home(flight, station)
        assert_loopback_only(flight)
        assert {system for system, kind in station.newest if kind == "HEARTBEAT"} == set(
            range(FIRST, FIRST + 12)
        )
        until_recorded(flight, 3.0)
        assert flight.cli("down", "--run", str(flight.folder)).returncode == 0, flight.said()
        assert flight.wait(60) == 0, flight.said()
    finally:
        station.close()
    for name in NAMES:
        told = flight.stats(
            f"forward.{name}"
        )  # PX4 passes the router's heartbeats on; datagrams come from nobody but itself
        assert not [key for key in told if "foreign datagram" in key or "not in frame" in key], name
        assert_logged_at_home(flight, name)
    flight.assert_nothing_left()
