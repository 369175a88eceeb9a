"""A new vendor is one package and one row of the table: the plan, the emulator, every client and the forwarder take it."""

from __future__ import annotations

import select
import socket
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import InputError
from arena.geometry import quat_from_euler
from arena.mocap.client import open_client
from arena.mocap.emulator import open_server
from arena.mocap.emulator.core import EmulatedCameras
from arena.mocap.vendors import VENDORS, vendor_settings
from arena.plan import slices
from arena.plan.job import Job
from arena.pose_forwarder.forwarder import Forwarder
from arena.schema.base import Strict
from arena.schema.mocap import VENDOR_KEYS, Mocap, keys_of_other_vendors
from arena.uav.arguments import read_arguments
from arena.wire.truth_page import Truth
from tests.mocap.rig import row

ADDRESS = "127.51.7.1"
P_N, RPY = np.array([1.25, -0.5, -1.75]), np.radians([10.0, -20.0, 35.0])
NOISE = {"position_m": 0.0003, "rotation_deg": 0.05}
FORWARDER = {"id": 1, "body": "uav1", "frame_rate_hz": 180, "rate_hz": 60, "stale_s": 0.1, "origin": None}


class ToyKeys(Strict):
    """The toy's own YAML keys."""

    toy_port: int = 7777


@pytest.fixture(autouse=True)
def toy_vendor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register the toy by its row in the table of vendors."""
    monkeypatch.setitem(VENDORS, "toy", f"{__package__}.toy")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind((ADDRESS, 0))
        return s.getsockname()[1]


def planned(port: int) -> tuple[dict, dict]:
    """Return the slices of emulator and client as the plan writes them for an arena whose emulator serves the toy."""
    keys = {"toy_port": port, "server": None, "local": None}
    mocap = SimpleNamespace(
        emulates="toy",
        source="emulator",
        keys=keys,
        rate_hz=180.0,
        latency_ms=10.0,
        seed=1,
        noise=SimpleNamespace(position_mm=0.3, rotation_deg=0.05),
    )
    vehicle = SimpleNamespace(mocap_body="uav1", id=4, simulated=True)
    arena = SimpleNamespace(address=ADDRESS, mocap=mocap, simulated=[vehicle], hardware=[])
    return slices.mocap(Job(arena=arena, fleet={}, python="py")), slices.capture(
        arena, ["uav1"], simulated=True
    )


def truth_at(time_s: float) -> Truth:
    z, p_n = np.zeros((1, 3)), (P_N + np.array([0.2 * time_s, 0.0, 0.0])).reshape(1, 3)
    q_nb = quat_from_euler(RPY).reshape(1, 4)
    return Truth(time_s=time_s, p_n=p_n, q_nb=q_nb, v_n=z, omega_b=z, accel_b=z, motors=np.zeros((1, 4)))


def test_toy_vendor_flies_from_the_emulator_to_the_forwarder():
    server_slice, client_slice = planned(free_port())
    cameras, client, server = (
        EmulatedCameras(server_slice),
        open_client(client_slice),
        open_server(server_slice),
    )
    forwarder, codec = Forwarder({**FORWARDER, "noise": NOISE}), mavlink.MAVLink(None)
    assert client.diagnosis() == f"motion capture: no frame from {ADDRESS}: is the toy switched on?"
    sent = []
    for number in range(1, 181):
        cameras.enqueue(number, row(truth_at(cameras.exposure(number))))
        now = cameras.due(number)
        for frame in cameras.leaving(now):
            assert server.send(frame, now, wall=now) == 0
            assert select.select([client], [], [], 5.0)[0]
            data = forwarder.on_frames(client.poll(now), now)
            sent += [] if data is None else [(frame.exposed_s, codec.decode(bytearray(data)))]
    assert len(sent) == pytest.approx(60, abs=1)
    exposed_s, odometry = sent[-1]
    assert np.allclose((odometry.x, odometry.y, odometry.z), truth_at(exposed_s).p_n[0], atol=0.002)
    assert np.allclose(odometry.q, quat_from_euler(RPY), atol=0.005)
    assert client.diagnosis() == ""
    server.close()
    client.close()


def test_toy_vendor_reports_a_missing_body():
    server_slice, client_slice = planned(free_port())
    client, server = open_client({**client_slice, "bodies": ["UAV1"]}), open_server(server_slice)
    server.send(EmulatedCameras(server_slice).measure(1, row(truth_at(0.0))), 0.0, wall=0.0)
    assert select.select([client], [], [], 5.0)[0]
    client.poll(0.0)
    assert "has no body 'UAV1'; its bodies: 'uav1'. Did you mean 'uav1'?" in client.diagnosis()
    server.close()
    client.close()


def test_toy_vendor_is_listed_in_the_open_ports_and_checks():
    toy = vendor_settings("toy")
    (used,) = toy.client_sockets({"server": ADDRESS, "local": ADDRESS, "port": 7777})
    assert (used.port, used.what) == (7777, "toy frames")
    assert list(toy.problems({"toy_port": 13})) == [("toy_port", "got 13, expected another port. Try 7777.")]


def test_program_reads_the_toy_vendor_by_hand():
    found = read_arguments(["--ns", "uav1", "--capture", "toy:10.0.0.5:7001"])
    assert found["capture"] == {
        "kind": "toy",
        "server": "10.0.0.5",
        "local": None,
        "port": 7001,
        "bodies": ["uav1"],
    }


def test_key_of_a_vendor_that_is_not_used_is_found(monkeypatch):
    monkeypatch.setitem(VENDOR_KEYS, "toy", ToyKeys)  # type: ignore[arg-type]
    assert keys_of_other_vendors(Mocap()) == {"toy_port": "toy"}


def test_unknown_vendor_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="got vendor 'vicon', expected one of natnet, toy"):
        open_client({"kind": "vicon", "bodies": []})
