"""Tests of what people do to a flying arena: ps, top, logs, an SDK, a ground station, restart."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec

from .flight import PROGRAMS, Flight, Hangar, eventually

pytestmark = pytest.mark.flight
VEHICLES = {"uav1": "hovers", "uav2": "hovers"}
SDK_PORT = 22000
GROUND_STATION_PORT, ROUTER_TO_STATIONS = 14550, 24000


@pytest.fixture(scope="module")
def flying(shared_hangar: Hangar) -> Iterator[Flight]:
    """Give an arena that hovers until all tests of the module are done."""
    flight = shared_hangar.fly(VEHICLES, "--speed", "3", "--processes")
    flight.until_up(0.9)
    yield flight


class Client:
    """An external MAVLink client made of pymavlink: an SDK or a ground station."""

    def __init__(self, address: tuple[str, int], peer: tuple[str, int], component: int) -> None:
        self._codec, self._peer = Codec(245, component), peer
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(address)
        self.received: list[Any] = []

    def send(self, message: Any) -> None:
        self._socket.sendto(self._codec.pack(message), self._peer)

    def listen(self) -> None:
        """Return all messages received so far."""
        with contextlib.suppress(BlockingIOError):
            while True:
                self.received += self._codec.parse(self._socket.recv(65535))

    def until_heard(self, kind: str, systems: set[int]) -> None:
        def has() -> bool:
            self.listen()
            return systems <= {m.get_srcSystem() for m in self.received if m.get_type() == kind}

        eventually(
            has,
            5,
            f"{kind} from {systems}",
            lambda: {(m.get_srcSystem(), m.get_type()) for m in self.received},
        )

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def client(flying: Flight) -> Iterator[Any]:
    made: list[Client] = []

    def make(port: int, peer: int, component: int) -> Client:
        made.append(Client((flying.address, port), (flying.address, peer), component))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_sdk_port_carries_one_vehicle_only(flying: Flight, client: Any) -> None:
    for number, vehicle in enumerate(VEHICLES, start=1):
        serve = flying.json("slices/router.json")["vehicles"][number - 1]["serve"][1]
        sdk = client(SDK_PORT + number, serve, 190)
        sdk.until_heard("ATTITUDE", {number})
        sdk.send(mavlink.MAVLink_param_request_read_message(number, 1, b"MAV_SYS_ID", -1))
        sdk.until_heard("PARAM_VALUE", {number})
        sdk.until_heard("HEARTBEAT", {number})
        known = [
            m for m in sdk.received if not m.get_type().startswith("UNKNOWN")
        ]  # the dialect has no CURRENT_MODE yet
        assert {m.get_srcSystem() for m in known} == {number}, vehicle
        assert [m.param_id for m in sdk.received if m.get_type() == "PARAM_VALUE"] == ["MAV_SYS_ID"]


def test_ground_station_receives_every_vehicle(flying: Flight, client: Any) -> None:
    station = client(GROUND_STATION_PORT, ROUTER_TO_STATIONS, 190)
    station.until_heard("HEARTBEAT", {1, 2})
    station.send(mavlink.MAVLink_param_request_read_message(2, 1, b"MPC_LAND_SPEED", -1))
    station.until_heard("PARAM_VALUE", {2})
    assert {m.get_srcSystem() for m in station.received if m.get_type() == "PARAM_VALUE"} == {2}


def test_ground_station_gets_its_own_streams_and_each_reply_once(flying: Flight, client: Any) -> None:
    station = client(GROUND_STATION_PORT, ROUTER_TO_STATIONS, 190)
    station.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    station.until_heard("ATTITUDE", {1, 2})
    version = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    for number, parameters in ((511, (30, -1)), (512, (version,))):
        values = [*parameters, *[0] * 7][:7]
        station.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))
    station.until_heard("AUTOPILOT_VERSION", {1})
    station.send(mavlink.MAVLink_ping_message(0, 1, 0, 0))
    station.until_heard("PING", {1, 2})  # a second reply would have arrived before
    station.until_heard("VIBRATION", {1, 2})  # 0.1 Hz, so that nothing else is on its way
    names = {m.get_type() for m in station.received}
    assert not names & {"HIGHRES_IMU", "ODOMETRY", "TIMESYNC"}
    acknowledged = [m.command for m in station.received if m.get_type() == "COMMAND_ACK"]
    assert sorted(acknowledged) == [511, 512]
    serve = flying.json("slices/router.json")["vehicles"][0]["serve"][1]
    client(SDK_PORT + 1, serve, 190).until_heard("ATTITUDE", {1})


def test_mavsdk_connects_and_reads_a_parameter(flying: Flight) -> None:
    pytest.importorskip("mavsdk.asyncio", reason="mavsdk 4 is not installed: pip install 'flying-arena[sdk]'")
    command = [sys.executable, str(PROGRAMS / "sdk.py"), f"udpin://{flying.address}:{SDK_PORT + 2}"]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    told = json.loads(ran.stdout.splitlines()[-1])
    assert told == {"received": [2], "descent_m_s": pytest.approx(0.7), "armed": True}


def test_ps_lists_every_process_and_vehicle(flying: Flight) -> None:
    told = flying.cli("ps", "--json")
    assert told.returncode == 0, told.stderr
    status = json.loads(told.stdout)
    assert (
        status["phase"] == "running"
        and status["vehicles"] == list(VEHICLES)
        and status["run"] == str(flying.folder)
    )
    assert {row["state"] for row in status["processes"].values()} == {"READY"} and len(
        status["processes"]
    ) == 8
    assert flying.processes() == {row["pid"] for row in status["processes"].values()}
    assert {f"{flying.address}:16001", f"{flying.address}:24000"} <= {
        f"{c.laddr.ip}:{c.laddr.port}" for c in flying.sockets()
    }
    for vehicle in VEHICLES:
        assert (
            status["facts"][f"{vehicle}.armed"] is True and status["facts"][f"{vehicle}.mode"] == "OFFBOARD"
        )
    table = flying.cli("ps").stdout
    assert all(name in table for name in status["processes"])


def test_top_shows_every_vehicle_with_its_state_and_every_process(flying: Flight) -> None:
    shown = flying.cli("top", "--once", "--run", str(flying.folder))
    assert shown.returncode == 0, shown.stderr
    rows = {line.split()[0]: line.split() for line in shown.stdout.splitlines() if line.split()}
    for vehicle in VEHICLES:
        words = rows[vehicle]
        assert words[1:5] == ["OFFBOARD", "yes", "no", "program"]
        height = float(words[words.index("%") + 5])  # 97 % N m E m height m
        assert 0.8 < height < 1.5
    assert {"world", "router", "mocap", "program.uav1", "forward.uav2"} <= set(rows)


def test_logs_prints_a_log_and_refuses_an_unknown_process(flying: Flight) -> None:
    assert flying.cli("logs", "program.uav1").stdout == "above\n"
    nobody = flying.cli("logs", "program.uav9")
    assert nobody.returncode == 2 and "program.uav1" in nobody.stderr


def test_second_arena_on_the_same_address_is_refused(flying: Flight) -> None:
    again = flying.cli("up", str(flying.folder / "arena.yaml"), "--headless")
    assert again.returncode == 1 and str(flying.folder) in again.stderr and "is running on" in again.stderr


def test_forwarder_restart_in_flight_keeps_the_vehicle_flying(flying: Flight) -> None:
    first = flying.pid("forward.uav1")
    poses = flying.status()["processes"]["world"]["stats"]["autopilot"]["uav1"]["vision"]
    refused = flying.cli("restart", "forward.uav1")
    assert refused.returncode == 1 and "--yes" in refused.stderr and flying.pid("forward.uav1") == first
    with flying.paced(0.05):  # the restart takes less simulated time than the vehicle flies without poses
        assert flying.cli("restart", "forward.uav1", "--yes").returncode == 0
        flying.until_event("forward.uav1", "READY", 15, times=2)
    eventually(
        lambda: flying.status()["processes"]["world"]["stats"]["autopilot"]["uav1"]["vision"] > poses + 200,
        10,
        "poses",
    )
    assert flying.pid("forward.uav1") != first
    status = flying.status()
    autopilot = status["processes"]["world"]["stats"]["autopilot"]["uav1"]
    assert (
        autopilot["failsafe"] == ""
        and status["facts"]["uav1.mode"] == "OFFBOARD"
        and flying.heights().min() > 0.5  # it drifts until the new forwarder sends poses
    )


def test_followed_log_ends_with_the_arena(flying: Flight) -> None:
    with flying.start_cli("logs", "program.uav1", "-f", "--run", str(flying.folder)) as follower:
        assert follower.stdout is not None and follower.stdout.readline() == "above\n"
        down = flying.cli("down")
        rest = follower.stdout.read()
        assert follower.wait(10) == 0
    assert "left OFFBOARD and is now in AUTO.LAND" in rest
    assert flying.wait() == down.returncode
    flying.assert_nothing_left()
