"""The emulator's process on loopback, read by independent clients and by our own receiver."""

from __future__ import annotations

import json
import os
import platform
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from natnet import NatNetClient

from arena.clock_server import ClockServer
from arena.fault_injection import inject
from arena.geometry import quat_from_euler
from arena.mocap.client import open_client
from arena.process_context import SOCKET_VARIABLE
from arena.wire.truth_page import Truth, TruthWriter


class World:
    """A clock that keeps real time and a truth page in which two bodies stand still at a generic attitude."""

    Q_NB = quat_from_euler(np.radians([[10.0, -20.0, 35.0], [0.0, 0.0, 0.0]]))
    P_N = np.array([[1.25, -0.5, -1.75], [0.0, 0.0, -1.0]])

    def __init__(self, folder) -> None:
        self.clock, self.truth = (
            ClockServer(folder / "clock"),
            TruthWriter(folder / "truth", 2, period_s=0.004),
        )
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        z, begin, k = np.zeros((2, 3)), time.monotonic(), 0
        while not self._ending.is_set():
            k += 1
            now = 0.004 * k
            self.truth.write(
                Truth(
                    time_s=now,
                    p_n=self.P_N,
                    q_nb=self.Q_NB,
                    v_n=z,
                    omega_b=z,
                    accel_b=z,
                    motors=np.zeros((2, 4)),
                )
            )
            self.clock.tick(now)
            late_s = time.monotonic() - (begin + now)
            begin += max(0.0, late_s)  # after a pause of the computer it does not catch up
            self.clock.poll(max(0.0, -late_s))

    def end(self) -> None:
        self._ending.set()
        self._thread.join(5)
        self.clock.close()


def free_port(address: str) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind((address, 0))
        return s.getsockname()[1]


@contextmanager
def emulator(tmp_path, address: str, **changes):
    """A running `python -m arena.mocap.emulator`; gives its settings once it has told that it is ready."""
    world = World(tmp_path)
    settings = {
        "name": "mocap",
        "kind": "natnet",
        "address": address,
        "version": "3.1",
        "transport": "multicast",
        "group": "239.255.42.99",
        "command_port": free_port(address),
        "data_port": free_port(address),
        "rate_hz": 180,
        "latency_ms": 10,
        "seed": 1,
        "noise": {"position_m": 0.0003, "rotation_deg": 0.05},
        "clock": str(tmp_path / "clock"),
        "truth": str(tmp_path / "truth"),
        "bodies": [
            {"name": "uav1", "number": 1, "index": 0},
            {"name": "aero2", "number": 7, "index": 1},
        ],
        **changes,
    }
    (tmp_path / "slice.json").write_text(json.dumps(settings))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(60)
    env = {**os.environ, SOCKET_VARIABLE: str(theirs.fileno())}
    command = [sys.executable, "-m", "arena.mocap.emulator", str(tmp_path / "slice.json")]
    process = subprocess.Popen(command, env=env, pass_fds=[theirs.fileno()])
    theirs.close()
    try:
        assert [json.loads(ours.recv(4096)) for _ in range(2)] == [{"entered": True}, {"ready": True}]
        settings["line"] = ours
        yield settings
    finally:
        process.terminate()
        assert process.wait(30) == 0
        ours.close()
        world.end()


def receive(client, enough) -> list:
    """Return the frames that the client of PyPI hands out, until `enough(frames)` is true."""
    frames: list = []
    client.on_data_frame_received_event.handlers.append(frames.append)
    client.run_async()
    end = time.monotonic() + 60.0
    while not enough(frames):
        assert time.monotonic() < end, f"{len(frames)} frames in 60 s"
        time.sleep(0.05)
    client.stop_async()
    return frames


@pytest.mark.parametrize("version", ["3.1", "4.1"])
@pytest.mark.parametrize("transport", ["multicast", "unicast"])
def test_the_natnet_package_reads_the_frames_in_order(tmp_path, version, transport):
    with emulator(tmp_path, "127.0.0.1", version=version, transport=transport) as s:
        client = NatNetClient(
            server_ip_address="127.0.0.1",
            local_ip_address="127.0.0.1",
            multicast_address=s["group"],
            command_port=s["command_port"],
            data_port=s["data_port"],
            use_multicast=transport == "multicast",
        )
        names: list = []
        client.on_data_description_received_event.handlers.append(names.append)
        with client:
            client.request_modeldef()
            frames = receive(client, lambda frames: names and len(frames) > 30)
    assert [b.name for b in names[0].rigid_bodies] == ["uav1", "aero2"]
    numbers = [f.prefix.frame_number for f in frames]
    assert numbers == sorted(set(numbers))
    east, north, up = frames[-1].rigid_bodies[0].pos
    assert np.allclose([north, east, -up], World.P_N[0], atol=0.003)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="motioncapture has an x86_64 wheel only")
@pytest.mark.parametrize("version", ["3.1", "4.1"])
@pytest.mark.parametrize("transport", ["multicast", "unicast"])
def test_the_motioncapture_package_reads_names_and_poses(tmp_path, version, transport):
    """In a process of its own: the package blocks inside its library, where only a kill reaches it."""
    script = """
import sys, motioncapture
mc = motioncapture.connect("optitrack", {"hostname": "127.0.0.1", "interface_ip": "127.0.0.1", "port_command": sys.argv[1]})
for _ in range(100):
    mc.waitForNextFrame()
bodies = mc.rigidBodies  # kept: a body does not outlive the mapping it came from
print(sorted(bodies), *bodies["uav1"].position)
"""
    with emulator(tmp_path, "127.0.0.1", version=version, transport=transport) as s:
        out = subprocess.run(
            [sys.executable, "-c", script, str(s["command_port"])],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    assert out.returncode == 0, out.stderr
    names, _, position = out.stdout.splitlines()[-1].partition("] ")
    assert names == "['aero2', 'uav1'"
    east, north, up = map(float, position.split())
    assert np.allclose([north, east, -up], World.P_N[0], atol=0.003)


def test_program_that_only_listens_receives_frames(tmp_path):
    """Some receivers of multicast send no request. The emulator must find their port by itself."""
    address, group = "127.51.1.3", "239.243.51.3"
    with (
        emulator(tmp_path, address, group=group) as s,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
    ):
        time.sleep(0.3)  # the emulator finds the port closed
        one.settimeout(30)
        one.bind((group, s["data_port"]))
        member = socket.inet_aton(group) + socket.inet_aton(address)
        one.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        assert all(len(one.recv(4096)) > 100 for _ in range(20))


@pytest.mark.parametrize("version", ["3.1", "4.1"])
@pytest.mark.parametrize("transport", ["multicast", "unicast"])
def test_our_receiver_gets_180_frames_a_second_in_ned(tmp_path, version, transport):
    address = "127.51.1.1" if transport == "unicast" else "127.51.1.2"
    with emulator(tmp_path, address, version=version, transport=transport, group="239.243.51.1") as s:
        capture = open_client(
            {
                "kind": "natnet",
                "server": address,
                "local": address,
                "group": s["group"],
                "transport": transport,
                "command_port": s["command_port"],
                "data_port": s["data_port"],
                "bodies": ["aero2", "uav1"],
            }
        )
        frames, end = [], time.monotonic() + 60
        while len(frames) < 200:
            assert time.monotonic() < end, f"{len(frames)} frames in 60 s: {capture.counts}"
            threading.Event().wait(0.005)
            frames += capture.poll(time.monotonic())
        capture.close()
    span = frames[-1].number - frames[0].number
    # the emulator skips frames on a busy machine: at least half of them must arrive
    assert span <= 2 * len(frames), f"{len(frames)} frames of {span}: {capture.counts}"
    poses = {p.body: p for p in frames[-1].poses}
    assert np.allclose(poses["uav1"].p_n, World.P_N[0], atol=0.003)
    assert np.allclose(poses["uav1"].q_nb, World.Q_NB[0], atol=0.005)
    assert np.allclose(poses["aero2"].p_n, World.P_N[1], atol=0.003)


def test_faults_are_taken_by_the_process_told_and_its_socket_is_gone_at_the_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    address, path = "127.61.1.1", str(tmp_path / "mocap.faults")
    with emulator(tmp_path, address, group="239.253.61.1", faults=path) as s:
        capture = open_client(
            {
                "kind": "natnet",
                "server": address,
                "local": address,
                "group": s["group"],
                "transport": "multicast",
                "command_port": s["command_port"],
                "data_port": s["data_port"],
                "bodies": ["uav1"],
            }
        )

        def see(what):
            end = time.monotonic() + 60
            while not any(what(p) for f in capture.poll(time.monotonic()) for p in f.poses):
                assert time.monotonic() < end, capture.counts
                threading.Event().wait(0.005)

        see(lambda pose: np.allclose(pose.p_n, World.P_N[0], atol=0.003))
        inject("mocap.faults", {"do": "jump", "body": "uav1", "by_m": [0.5, -1, 0.25]})
        see(lambda pose: np.allclose(pose.p_n, World.P_N[0] + [0.5, -1, 0.25], atol=0.003))
        inject("mocap.faults", {"do": "delay", "ms": 300})
        inject("mocap.faults", {"do": "jump", "body": "uav2", "by_m": [0.5, -1, 0.25]})
        for _ in range(50):  # more than a socket holds
            inject("mocap.faults", {"do": "freeze", "body": "aero2", "on": True})
        told = []
        while len(told) < 53:
            packet = json.loads(s["line"].recv(4096))
            told += [packet["event"]] if "event" in packet else []
        see(lambda pose: True)
        capture.close()
    assert told[:2] == [
        "fault: the pose of uav1 is shifted by 0.5 -1 0.25 m",
        "fault: frames are delayed by 300 ms",
    ]
    assert told[2].startswith("fault refused: ") and told[2].endswith(
        'body: got "uav2", expected one of uav1, aero2'
    )
    assert not (tmp_path / "mocap.faults").exists()
