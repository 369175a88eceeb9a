"""The link as a process: over UDP, and over a serial line with a controller in the loop between the world and the links."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Stream

from .parts import ENDS, ID, arm, attitude, heartbeat, local, odometry, own_address, slice_of, sys_status

DEADLINE_S = 60.0
BOARD = Path(__file__).parents[1] / "children" / "hitl_board.py"


class Started:
    """The room as a process, its line to a supervisor, and its three partners."""

    def __init__(self, folder: Path, **changes: Any) -> None:
        self.address = own_address()
        settings = slice_of(
            self.address, **{"params_file": str(folder / "params" / "uav7.params"), **changes}
        )
        (folder / "slice.json").write_text(json.dumps(settings))
        self.links = {n: udp((self.address, 24001 + 2 * i)) for i, n in enumerate(ENDS)}
        self.line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.out = folder / "out.txt"
        with self.out.open("wb") as out:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "arena.fcu_link", str(folder / "slice.json")],
                stdout=out,
                stderr=out,
                env={**os.environ, "ARENA_FD": str(theirs.fileno())},
                pass_fds=[theirs.fileno()],
            )
        theirs.close()
        self.line.setblocking(False)
        self.told: list[dict[str, Any]] = []
        self.got: dict[str, list[Any]] = {n: [] for n in ENDS}
        self._codec = Codec(ID, 191)

    def send(self, link: str, *messages: Any, codec: Codec | None = None) -> None:
        to = 24000 + 2 * ENDS.index(link)
        self.links[link].sendto(
            b"".join((codec or self._codec).pack(m) for m in messages), (self.address, to)
        )

    def look(self) -> None:
        for name, link in self.links.items():
            self.got[name] += read_all(link, self._codec)
        with contextlib.suppress(BlockingIOError):
            while packet := self.line.recv(65536):
                self.told.append(json.loads(packet))

    def until(self, done: Callable[[], Any], turn: Callable[[], None] = lambda: None) -> Any:
        """turn: what the others do meanwhile, every few milliseconds."""
        end = time.monotonic() + DEADLINE_S
        while time.monotonic() < end:
            turn()
            select.select([*self.links.values(), self.line], [], [], 0.004)
            self.look()
            if found := done():
                return found
            assert self.process.poll() is None, self.out.read_text()
        raise AssertionError(f"not in {DEADLINE_S} s: {self.events[-5:]}, {self.stats}")

    @property
    def events(self) -> list[str]:
        return [t["event"] for t in self.told if "event" in t]

    @property
    def stats(self) -> dict[str, Any]:
        return next((t["stats"] for t in reversed(self.told) if "stats" in t), {})

    @property
    def ready(self) -> bool:
        return any("ready" in t for t in self.told)

    def heard(self, end: str, kind: str) -> list[Any]:
        return [m for m in self.got[end] if m.get_type() == kind]

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for link in (*self.links.values(), self.line):
            link.close()


def udp(address: tuple[str, int]) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(address)
    made.setblocking(False)
    return made


def read_all(link: socket.socket, codec: Codec) -> list[Any]:
    found: list[Any] = []
    with contextlib.suppress(OSError):
        while True:
            found += codec.parse(link.recv(65535))
    return found


class Vehicle:
    """An autopilot at the other end of a UDP wire."""

    def __init__(self, address: tuple[str, int], to: tuple[str, int] | None) -> None:
        self.link, self.to, self.codec, self.got = udp(address), to, Codec(ID, 1), []
        self.next = 0.0

    def turn(self) -> None:
        while True:
            try:
                data, sender = self.link.recvfrom(65535)
            except OSError:
                break
            self.to = self.to or sender
            self.got += self.codec.parse(data)
        if self.to and time.monotonic() >= self.next:
            self.next = time.monotonic() + 0.02
            for m in (heartbeat(), sys_status(), attitude(), local()):
                self.link.sendto(self.codec.pack(m), self.to)

    def heard(self, kind: str) -> list[Any]:
        return [m for m in self.got if m.get_type() == kind]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Started]]:
    made: list[Started] = []

    def begin(**changes: Any) -> Started:
        made.append(Started(tmp_path, **changes))
        return made[-1]

    yield begin
    for one in made:
        one.end()


def test_a_vehicle_that_speaks_first_is_met_armed_by_the_gates_and_left_when_told(start):
    room = start()
    vehicle = Vehicle((room.address, 14999), (room.address, 14540))
    stranger = udp((room.address, 14998))
    with vehicle.link, stranger:
        room.until(lambda: room.ready and room.heard("router", "HEARTBEAT"), vehicle.turn)
        stranger.sendto(Codec(ID, 1).pack(heartbeat(armed=True)), (room.address, 14540))
        room.send("router", arm())
        room.until(lambda: room.heard("router", "COMMAND_ACK"), vehicle.turn)
        assert "Preflight: no pose has come" in {t.text for t in room.heard("router", "STATUSTEXT")}
        assert not vehicle.heard("COMMAND_LONG") or all(
            m.command == 511 for m in vehicle.heard("COMMAND_LONG")
        )
        forwarder = Codec(ID, 197)

        def flies() -> None:
            if time.monotonic() >= vehicle.next:
                room.send("vision", odometry(), codec=forwarder)
            vehicle.turn()

        room.until(
            lambda: (
                room.stats.get("may_not_arm") == [] and "from the wire: stranger" in room.stats["dropped"]
            ),
            flies,
        )
        room.send("router", arm())
        room.until(lambda: any(m.command == 400 for m in vehicle.heard("COMMAND_LONG")), flies)
        assert room.stats["partner"] == f"{room.address}:14999"
        assert {m.get_srcSystem() for m in room.heard("vision", "HEARTBEAT")} == {ID}
        assert not room.heard("panic", "HEARTBEAT")
        assert not any(m.base_mode & 128 for m in room.heard("router", "HEARTBEAT")), (
            "a stranger spoke as the vehicle"
        )
        room.process.send_signal(signal.SIGTERM)
        assert room.process.wait(30) == 0


def test_a_vehicle_that_waits_to_be_spoken_to_is_spoken_to(start):
    address = own_address()
    vehicle = Vehicle((address, 14550), None)
    with vehicle.link:
        room = start(wire={"kind": "udpout", "address": [address, 14550]})
        room.until(lambda: room.ready, vehicle.turn)
        assert vehicle.heard("HEARTBEAT")[0].type == 18


def test_a_serial_device_that_is_absent_is_told_and_waited_for_and_one_unplugged_is_met_again(
    start, tmp_path
):
    device = tmp_path / "ttyACM0"
    room = start(wire={"kind": "serial", "device": str(device), "baud": 921600})
    room.until(lambda: any(f"there is no {device}" in e for e in room.events))
    for plugged in range(2):
        master, slave = pty.openpty()
        tty.setraw(master)
        os.set_blocking(master, False)
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(slave))
        beat, before = Codec(ID, 1).pack(heartbeat()), len(room.heard("router", "HEARTBEAT"))

        def speak(master: int = master, beat: bytes = beat) -> None:
            with contextlib.suppress(BlockingIOError):
                os.write(master, beat[:9])
                os.write(master, beat[9:])

        room.until(lambda before=before: len(room.heard("router", "HEARTBEAT")) > before, speak)
        gone = sum("is gone" in e for e in room.events)
        assert gone == plugged
        device.unlink()
        os.close(slave)
        os.close(master)
        room.until(lambda gone=gone: sum("is gone" in e for e in room.events) > gone)


def test_it_outlives_its_supervisor_while_the_vehicle_is_armed_and_ends_after(start):
    room = start()
    vehicle = Vehicle((room.address, 14999), (room.address, 14540))
    codec = Codec(ID, 1)
    with vehicle.link:
        armed = codec.pack(heartbeat(armed=True))
        room.until(lambda: room.stats.get("armed"), lambda: vehicle.link.sendto(armed, vehicle.to))
        room.line.close()
        with pytest.raises(subprocess.TimeoutExpired):  # the radio is lost: silent, and armed
            room.process.wait(3.0)
        end = time.monotonic() + DEADLINE_S
        while room.process.poll() is None and time.monotonic() < end:
            vehicle.link.sendto(codec.pack(heartbeat()), vehicle.to)
            with contextlib.suppress(subprocess.TimeoutExpired):
                room.process.wait(0.1)
        assert room.process.poll() == 0


# -- in the loop -----------------------------------------------------------------------------------------------------------


class WorldPort:
    """The world's simulator port: samples of a vehicle at rest, at 250 Hz at most, and what is answered."""

    def __init__(self, address: str) -> None:
        self.listener = socket.create_server((address, 24079))
        self.listener.setblocking(False)
        self.connection: socket.socket | None = None
        self.answers: list[Any] = []
        self.strange: list[int] = []
        self.gone = False
        self._codec, self._stream = Codec(1, 200), Stream()
        self.sent, self._last = 0, 0.0

    def turn(self) -> None:
        if self.connection is None:
            with contextlib.suppress(BlockingIOError):
                self.connection, _ = self.listener.accept()
                self.connection.setblocking(False)
            return
        if (
            time.monotonic() - self._last >= 0.004
        ):  # one at a time: a busy machine slows the world's clock down
            self.sent, self._last = self.sent + 1, time.monotonic()
            data = self._codec.pack(self._sample())
            if self.sent % 5 == 0:
                data += self._codec.pack(
                    mavlink.MAVLink_hil_state_quaternion_message(1, [1, 0, 0, 0], *[0] * 14)
                )
            try:
                self.connection.sendall(data)
            except (BrokenPipeError, ConnectionResetError):
                return self._hang_up()
        with contextlib.suppress(BlockingIOError):
            data = self.connection.recv(65536)
            if not data:
                return self._hang_up()
            buffer, found = self._stream.feed(data)
            self.strange += [f.msgid for f in found.frames if f.msgid != 93]
            for f in found.frames:
                self.answers += self._codec.parse(buffer[f.start : f.end])

    def _hang_up(self) -> None:
        self.connection.close()
        self.connection, self.gone, self.sent = None, True, 0
        self.answers.clear()

    def _sample(self) -> Any:
        wiggle = 0.01 * (self.sent % 7 - 3)
        return mavlink.MAVLink_hil_sensor_message(
            self.sent * 4000,
            wiggle,
            -wiggle,
            -9.81 + wiggle,
            wiggle / 9,
            0.002,
            -0.003,
            0.2,
            0.01,
            0.43,
            955.0,
            0.0,
            488.0 + wiggle,
            25.0,
            0x1FFF,
            0,
        )

    def close(self) -> None:
        self.listener.close()
        if self.connection is not None:
            self.connection.close()


@pytest.fixture
def board(
    serial_cable: tuple[str, str], tmp_path: Path
) -> Iterator[tuple[str, Callable[[dict[str, float]], subprocess.Popen[bytes]]]]:
    """(device, how to switch the controller on): a cable, the controller on one end and the link's device the other."""
    device, far_end = serial_cable
    running = []

    def switch_on(params: dict[str, float]) -> subprocess.Popen[bytes]:
        file = tmp_path / "board.params"
        file.write_text("".join(f"{k} {v}\n" for k, v in params.items()))
        running.append(subprocess.Popen([sys.executable, str(BOARD), far_end, str(ID), str(file)]))
        return running[-1]

    yield device, switch_on
    for process in running:
        process.kill()
        process.wait()


def test_a_controller_in_the_loop_flies_the_worlds_body_and_speaks_to_the_router(start, board, tmp_path):
    device, switch_on = board
    world = WorldPort(own_address())
    held = {"SYS_HITL": 1, "MPC_XY_P": 0.95}
    room = start(
        wire={"kind": "serial", "device": device, "baud": 921600},
        simulator=[world.listener.getsockname()[0], 24079],
        params={**held, "HIL_ACT_FUNC1": 101},
        simulated=True,
        preflight={"battery": 0.0},
    )
    controller = switch_on(held)
    try:
        room.until(lambda: room.ready and len(world.answers) > 100, world.turn)
        assert set(world.strange) == {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT
        }  # who has not spoken is no controller to the world
        assert {m.flags for m in world.answers if m.get_type() != "HEARTBEAT"} == {0}
        assert not room.heard("router", "HIL_ACTUATOR_CONTROLS")
        rest = {"HEARTBEAT", "SYS_STATUS", "ATTITUDE", "SYSTEM_TIME"}
        room.until(lambda: rest <= {m.get_type() for m in room.got["router"]}, world.turn)
        room.send("router", arm())
        armed = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
        room.until(lambda: any(m.command == armed for m in room.heard("router", "COMMAND_ACK")), world.turn)
        answer = next(m for m in room.heard("router", "COMMAND_ACK") if m.command == armed)
        assert answer.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        assert "Preflight: no pose has come" in {t.text for t in room.heard("router", "STATUSTEXT")}
        room.until(
            lambda: "Preflight: HIL_ACT_FUNC1 is unknown to the vehicle" in room.stats["may_not_arm"],
            world.turn,
        )
        assert "7\t1\tHIL_ACT_FUNC1\t101\t6" in (tmp_path / "params" / "uav7.params").read_text()
        answered = len(world.answers)
        room.until(lambda: len(world.answers) > answered + 120, world.turn)
        world.gone = False
        controller.kill()  # motors that nobody commands any more must stop: the world sees it hang up
        room.until(lambda: world.gone, world.turn)
        switch_on(held)
        room.until(lambda: world.connection is not None and len(world.answers) > 100, world.turn)
    finally:
        world.close()
