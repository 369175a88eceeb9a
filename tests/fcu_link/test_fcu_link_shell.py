"""The link as a process: on UDP, on a serial line, and with a controller in the loop."""

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
from fake_autopilot import ARM, REQUEST, FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink
from served import Connection, Served, UdpPort

from arena.missing_reboots import ClockTime, MissingReboots
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Stream

from .link_rig import ENDS, ID, POSE, UID, arm, heartbeat, odometry, own_address, slice_of, version

DEADLINE_S = 60.0
BOARD = Path(__file__).parents[1] / "children" / "hitl_board.py"


class Started:
    """The link process, its line to the supervisor (this test), and its three UDP links."""

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
        self.packets: list[dict[str, Any]] = []
        self.got: dict[str, list[Any]] = {n: [] for n in ENDS}
        self._codec = Codec(ID, 191)

    def send(self, link: str, *messages: Any, codec: Codec | None = None) -> None:
        to = 24000 + 2 * ENDS.index(link)
        self.links[link].sendto(
            b"".join((codec or self._codec).pack(m) for m in messages), (self.address, to)
        )

    def permit(self) -> None:
        """Send the supervisor's request that grants the arm permit."""
        self.line.send(json.dumps({"do": "permit", "vehicle": "uav7", "by": "the test"}).encode())

    def read(self) -> None:
        for name, link in self.links.items():
            self.got[name] += read_all(link, self._codec)
        with contextlib.suppress(BlockingIOError):
            while packet := self.line.recv(65536):
                self.packets.append(json.loads(packet))

    def until(self, done: Callable[[], Any], turn: Callable[[], None] = lambda: None) -> Any:
        """Wait until `done` returns a true value. turn: called every few milliseconds meanwhile."""
        end = time.monotonic() + DEADLINE_S
        while time.monotonic() < end:
            turn()
            select.select([*self.links.values(), self.line], [], [], 0.004)
            self.read()
            if found := done():
                return found
            assert self.process.poll() is None, self.out.read_text()
        raise AssertionError(f"not in {DEADLINE_S} s: {self.events[-5:]}, {self.stats}")

    @property
    def events(self) -> list[str]:
        return [t["event"] for t in self.packets if "event" in t]

    @property
    def stats(self) -> dict[str, Any]:
        return next((t["stats"] for t in reversed(self.packets) if "stats" in t), {})

    @property
    def ready(self) -> bool:
        return any("ready" in t for t in self.packets)

    def received(self, end: str, kind: str) -> list[Any]:
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


def on_udp(autopilot: FakeAutopilot, address: tuple[str, int], remote: tuple[str, int] | None) -> Served:
    return Served([Connection(autopilot=autopilot, port=UdpPort(address), remote=remote)])


@pytest.fixture
def autopilot() -> FakeAutopilot:
    """Give an autopilot that would pass the preflight checks and leaves arming commands unanswered."""
    telemetry = ("HEARTBEAT", "SYS_STATUS", "ATTITUDE", "LOCAL_POSITION_NED")
    return FakeAutopilot(system=ID, uid2=UID, pos=POSE, telemetry=telemetry, ignore={ARM})


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Started]]:
    made: list[Started] = []

    def begin(**changes: Any) -> Started:
        made.append(Started(tmp_path, **changes))
        return made[-1]

    yield begin
    for one in made:
        one.end()


def test_a_vehicle_on_udpin_is_served_guarded_and_left_on_sigterm(start, autopilot):
    link = start()
    intruder = udp((link.address, 14998))
    with on_udp(autopilot, (link.address, 14999), (link.address, 14540)), intruder:
        link.until(lambda: link.ready and link.received("router", "HEARTBEAT"))
        intruder.sendto(Codec(ID, 1).pack(heartbeat(armed=True)), (link.address, 14540))
        link.send("router", arm())
        link.until(lambda: link.received("router", "COMMAND_ACK"))
        assert "Preflight: no pose received" in {t.text for t in link.received("router", "STATUSTEXT")}
        assert {c.command for c in list(autopilot.commands)} <= {REQUEST, 511}
        link.permit()
        forwarder = Codec(ID, 197)

        def flies() -> None:
            link.send("vision", odometry(), codec=forwarder)

        link.until(
            lambda: (
                link.stats.get("may_not_arm") == []
                and "from the vehicle: unknown sender" in link.stats["dropped"]
            ),
            flies,
        )
        link.send("router", arm())
        link.until(lambda: any(c.command == ARM for c in list(autopilot.commands)), flies)
        assert link.stats["partner"] == f"{link.address}:14999"
        assert {m.get_srcSystem() for m in link.received("vision", "HEARTBEAT")} == {ID}
        assert not link.received("panic", "HEARTBEAT")
        assert not any(m.base_mode & 128 for m in link.received("router", "HEARTBEAT")), (
            "an intruder was taken for the vehicle"
        )
        link.process.send_signal(signal.SIGTERM)
        assert link.process.wait(30) == 0


def test_a_vehicle_that_needs_a_reboot_after_a_push_must_not_arm(start, autopilot, tmp_path):
    missing = MissingReboots.read(tmp_path)
    autopilot.telemetry = (*autopilot.telemetry, "SYSTEM_TIME")
    uptime_s = autopilot.boot_s(time.monotonic() - 5.0) + 5.0
    missing.add(UID.hex(), "uav7", ["EKF2_EV_CTRL"], ClockTime.now(), uptime_s=uptime_s)
    missing.save()
    link = start(missing_reboots={"folder": str(tmp_path), "address": "id 7"})
    reason = "Preflight: reboot needed for EKF2_EV_CTRL"
    text = "uav7: needs a reboot: a push has written EKF2_EV_CTRL"
    with on_udp(autopilot, (link.address, 14999), (link.address, 14540)):
        link.until(lambda: reason in link.stats.get("may_not_arm", ()) and text in link.events)
        link.send("router", arm())
        link.until(lambda: reason in {t.text for t in link.received("router", "STATUSTEXT")})
        assert not any(c.command == ARM for c in list(autopilot.commands))
        autopilot.reboot()
        link.until(lambda: reason not in link.stats["may_not_arm"])


def test_review_fault_4_a_stranger_does_not_replace_a_silent_vehicle(start, autopilot, tmp_path):
    """Another vehicle with the same system id sends from another address, while the vehicle is silent in flight."""
    record = tmp_path / "wire" / "uav7.json"
    link = start(wire_file=str(record))
    bench = FakeAutopilot(system=ID, uid2=bytes(range(50, 68)), telemetry=("HEARTBEAT", "EXTENDED_SYS_STATE"))
    vehicle, other = (link.address, 14999), (link.address, 14998)
    autopilot.armed = True
    with on_udp(autopilot, vehicle, (link.address, 14540)):
        link.until(lambda: link.stats.get("armed"))
        autopilot.mute = True
        with on_udp(bench, other, (link.address, 14540)):

            def lands() -> None:
                link.send("panic", arm(param1=0.0), codec=Codec(253, 195))

            link.until(lambda: any("another vehicle answers" in e for e in link.events), lands)
            sent = len(autopilot.commands)
            link.until(lambda: len(autopilot.commands) > sent + 50, lands)
            assert link.stats["armed"] and link.stats["partner"] == f"{link.address}:14999"
            assert {(m.get_type(), getattr(m, "command", 0)) for m in list(bench.received)} == {
                ("COMMAND_LONG", REQUEST)
            }
    assert json.loads(record.read_text()) == {
        "kind": "udpin",
        "local": [link.address, 14540],
        "vehicle": list(vehicle),
        "uid": UID.hex(),
    }


def test_a_link_forwards_while_the_disk_does_not_respond(
    start, autopilot, tmp_path
):  # review faults 8 and 11
    """To open a pipe that nobody reads for writing takes for ever."""
    (tmp_path / "wire").mkdir()
    os.mkfifo(tmp_path / "wire" / "uav7.json.new")
    link = start(wire_file=str(tmp_path / "wire" / "uav7.json"))
    with on_udp(autopilot, (link.address, 14999), (link.address, 14540)):
        link.until(lambda: link.stats.get("uid") == UID.hex() and link.received("router", "HEARTBEAT"))
        link.process.send_signal(signal.SIGTERM)
        assert link.process.wait(30) == 0


def test_a_restarted_link_knows_the_uid_of_the_run(start, autopilot, tmp_path):
    record = tmp_path / "wire" / "uav7.json"
    record.parent.mkdir()
    there = {"kind": "udpin", "local": None, "vehicle": ["10.0.0.21", 14550], "uid": UID[::-1].hex()}
    record.write_text(json.dumps(there))
    link = start(wire_file=str(record))
    with on_udp(autopilot, (link.address, 14999), (link.address, 14540)):
        expected = f"expected {UID[::-1].hex()}"
        link.until(lambda: any("another vehicle answers" in e and expected in e for e in link.events))
        assert not link.received("router", "HEARTBEAT")
    found = json.loads(record.read_text())
    assert (found["vehicle"], found["uid"]) == (there["vehicle"], there["uid"])


def test_a_vehicle_on_udpout_gets_the_first_message(start, autopilot):
    address = own_address()
    with on_udp(autopilot, (address, 14550), None):
        link = start(wire={"kind": "udpout", "address": [address, 14550]})
        link.until(lambda: link.ready)
        assert autopilot.heartbeats[0].type == 18


def test_a_serial_device_may_be_absent_unplugged_and_back(start, tmp_path):
    device = tmp_path / "ttyACM0"
    link = start(wire={"kind": "serial", "device": str(device), "baud": 921600})
    link.until(lambda: any(f"there is no {device}" in e for e in link.events))
    for plugged in range(2):
        master, slave = pty.openpty()
        tty.setraw(master)
        os.set_blocking(master, False)
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(slave))
        data, before = (
            Codec(ID, 1).pack(version()) + Codec(ID, 1).pack(heartbeat()),
            len(link.received("router", "HEARTBEAT")),
        )

        def send(master: int = master, data: bytes = data) -> None:
            with contextlib.suppress(BlockingIOError):
                os.write(master, data[:9])
                os.write(master, data[9:])

        link.until(lambda before=before: len(link.received("router", "HEARTBEAT")) > before, send)
        gone = sum("is gone" in e for e in link.events)
        assert gone == plugged
        device.unlink()
        os.close(slave)
        os.close(master)
        link.until(lambda gone=gone: sum("is gone" in e for e in link.events) > gone)


def test_an_orphan_serves_until_the_vehicle_is_disarmed(start, autopilot):
    link = start()
    autopilot.armed = True
    with on_udp(autopilot, (link.address, 14999), (link.address, 14540)):
        link.until(lambda: link.stats.get("armed"))
        autopilot.mute = True  # silent and armed, as after the loss of its radio
        link.line.close()
        with pytest.raises(subprocess.TimeoutExpired):
            link.process.wait(2.3)
        autopilot.mute = autopilot.armed = False
        assert link.process.wait(DEADLINE_S) == 0


@pytest.mark.parametrize("forgotten", [False, True])
def test_stop_signal_does_not_end_the_link_of_an_armed_vehicle(
    start, autopilot, forgotten
):  # review faults 6, 18
    link = start()
    autopilot.armed = True
    with on_udp(autopilot, (link.address, 14999), (link.address, 14540)):
        link.until(lambda: link.stats.get("armed"))
        link.process.send_signal(signal.SIGTERM)
        link.until(lambda: any("stop signal received, but uav7 is armed" in e for e in link.events))
        if forgotten:
            link.line.send(b'{"do": "forget", "vehicle": "uav7", "dead": true}')
        else:
            autopilot.armed = False
        assert link.process.wait(DEADLINE_S) == 0


def test_pilot_keeps_the_vehicle_from_land_all_on_the_panic_link(start, autopilot):  # review fault 5
    link = start()
    land = mavlink.MAVLink_command_long_message(ID, 1, 176, 0, 1, 4, 6, 0, 0, 0, 0)
    land_all = Codec(253, 195)
    autopilot.armed, autopilot.mode = True, "OFFBOARD"
    with on_udp(autopilot, (link.address, 14999), (link.address, 14540)):
        link.until(lambda: link.stats.get("armed"))
        autopilot.mode, autopilot.telemetry = "POSCTL", (*autopilot.telemetry, "RC_CHANNELS")
        link.until(lambda: "uav7: pilot has control: POSCTL" in link.events)
        link.send("panic", land, codec=land_all)
        link.until(lambda: link.received("panic", "COMMAND_ACK"))
        assert "pilot has control" in {t.text for t in link.received("panic", "STATUSTEXT")}
        assert not any(c.command == 176 for c in list(autopilot.commands))
        link.line.send(json.dumps({"do": "release", "vehicle": "uav7", "by": "ada"}).encode())
        link.until(lambda: "uav7: pilot has control: still, after the release by ada" in link.events)
        assert autopilot.mode == "POSCTL"


# -- in the loop -----------------------------------------------------------------------------------------------------------


class WorldPort:
    """The world's simulator port: sends samples of a vehicle at rest, at most 250 Hz, and stores the answers."""

    def __init__(self, address: str) -> None:
        self.listener = socket.create_server((address, 24079))
        self.listener.setblocking(False)
        self.connection: socket.socket | None = None
        self.answers: list[Any] = []
        self.other_messages: list[int] = []
        self.gone = False
        self._codec, self._stream = Codec(1, 200), Stream()
        self.sent, self._last = 0, 0.0

    def turn(self) -> None:
        if self.connection is None:
            with contextlib.suppress(BlockingIOError):
                self.connection, _ = self.listener.accept()
                self.connection.setblocking(False)
            return
        if time.monotonic() - self._last >= 0.004:  # one at a time: a busy machine slows the simulation down
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
            try:
                data = self.connection.recv(65536)
            except ConnectionResetError:
                data = b""
            if not data:
                return self._hang_up()
            buffer, found = self._stream.feed(data)
            self.other_messages += [f.msgid for f in found.frames if f.msgid != 93]
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
    """Return (device of the link, function that starts a controller at the other end of the cable)."""
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


def test_a_controller_in_the_loop_is_between_world_and_router(start, board, tmp_path):
    device, switch_on = board
    world = WorldPort(own_address())
    held = {"SYS_HITL": 1, "MPC_XY_P": 0.95}
    link = start(
        wire={"kind": "serial", "device": device, "baud": 921600},
        simulator=[world.listener.getsockname()[0], 24079],
        params={**held, "HIL_ACT_FUNC1": 101},
        simulated=True,
        preflight={"battery": 0.0},
    )
    controller = switch_on(held)
    try:
        link.until(lambda: link.ready and len(world.answers) > 40, world.turn)
        assert set(world.other_messages) == {mavlink.MAVLINK_MSG_ID_HEARTBEAT}
        assert {m.flags for m in world.answers if m.get_type() != "HEARTBEAT"} == {0}
        assert not link.received("router", "HIL_ACTUATOR_CONTROLS")
        rest = {"HEARTBEAT", "SYS_STATUS", "ATTITUDE", "SYSTEM_TIME"}
        link.until(lambda: rest <= {m.get_type() for m in link.got["router"]}, world.turn)
        link.send("router", arm())
        armed = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
        link.until(
            lambda: any(m.command == armed for m in link.received("router", "COMMAND_ACK")), world.turn
        )
        answer = next(m for m in link.received("router", "COMMAND_ACK") if m.command == armed)
        assert answer.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        assert "Preflight: no pose received" in {t.text for t in link.received("router", "STATUSTEXT")}
        link.until(
            lambda: "Preflight: HIL_ACT_FUNC1 is unknown to the vehicle" in link.stats["may_not_arm"],
            world.turn,
        )
        assert "7\t1\tHIL_ACT_FUNC1\t101\t6" in (tmp_path / "params" / "uav7.params").read_text()
        answered = len(world.answers)
        link.until(lambda: len(world.answers) > answered + 50, world.turn)
        world.gone = False
        controller.kill()  # the link must disconnect from the world, so that the motors stop
        link.until(lambda: world.gone, world.turn)
        switch_on(held)
        link.until(lambda: world.connection is not None and len(world.answers) > 40, world.turn)
    finally:
        world.close()
