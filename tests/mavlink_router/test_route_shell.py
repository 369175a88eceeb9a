"""The router as a process: sockets, readiness, facts, the heartbeat, and its end."""

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
import types

import pytest
from fleet import OFFBOARD, ack, attitude, command, heartbeat, slice_of
from pymavlink.dialects.v20 import common as mavlink

from arena.mavlink_router.__main__ import Shell
from arena.mavlink_router.routing_table import Table
from arena.process_context import ProcessContext

DEADLINE_S = 60.0


def wait_for(condition, what, deadline_s=DEADLINE_S):
    end = time.monotonic() + deadline_s
    while time.monotonic() < end:
        if found := condition(end - time.monotonic()):
            return found
    raise AssertionError(f"{what} did not happen in {deadline_s} s")


class Running:
    """The router's process with its line to a supervisor (us) and every neighbour's socket."""

    def __init__(self, folder, host, **kwargs):
        self.slice = slice_of((1, 2), host=host, gcs=(host, 14550), **kwargs)
        file = folder / "router.json"
        file.write_text(json.dumps(self.slice))
        self.sockets = {}
        for v in self.slice["vehicles"]:
            k = v["id"]
            self.open(f"autopilot{k}", v["link"]["remote"])
            self.open(f"program{k}", v["clients"][0]["address"])
            self.open(f"logger{k}", v["logger"])
        self.open("gcs", self.slice["gcs"][0]["address"])
        self.open("tool", [host, 0])
        self.line, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        env = {**os.environ, "ARENA_FD": str(child.fileno())}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "arena.mavlink_router", str(file)], env=env, pass_fds=[child.fileno()]
        )
        child.close()
        self.facts, self.stats, self.is_ready = {}, {}, False

    def open(self, name, address):
        s = self.sockets[name] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        s.bind(tuple(address))

    def say(self, who, data):
        v = self.slice["vehicles"][int(who[-1]) - 1] if who[-1].isdigit() else None
        to = (
            self.slice["gcs_local"]
            if who == "gcs"
            else self.slice["vehicles"][0]["tools"]
            if who == "tool"
            else (v["link"]["local"] if who.startswith("autopilot") else v["serve"])
        )
        with contextlib.suppress(ConnectionRefusedError):
            self.sockets[who].sendto(data, tuple(to))

    def hears(self, who, data, deadline_s=DEADLINE_S):
        """Wait until `who` receives exactly these bytes."""

        def look(left):
            return (
                select.select([self.sockets[who]], [], [], left)[0] and self.sockets[who].recv(65536) == data
            )

        wait_for(look, f"{who} hearing {data!r}", deadline_s)

    def told(self, condition, what, deadline_s=DEADLINE_S):
        def look(left):
            if condition():
                return True
            if select.select([self.line], [], [], left)[0]:
                packet = json.loads(self.line.recv(65536) or b"{}")
                self.facts |= packet.get("facts", {})
                self.stats |= packet.get("stats", {})
                self.is_ready |= packet.get("ready", False)
            return condition()

        wait_for(look, what, deadline_s)

    def start(self):
        """Autopilots beat until the router is ready."""

        def beat():
            for k in (1, 2):
                self.say(f"autopilot{k}", heartbeat(k))
            return self.is_ready

        wait_for(lambda left: self.told_once() or beat(), "readiness")

    def told_once(self):
        with contextlib.suppress(AssertionError):
            self.told(lambda: self.is_ready, "readiness", 0.05)
        return self.is_ready

    def close(self):
        self.process.kill()
        self.process.wait()
        self.line.close()
        for s in self.sockets.values():
            s.close()


@pytest.fixture
def running(tmp_path, request):
    router = Running(tmp_path, **request.param)
    try:
        yield router
    finally:
        router.close()


def at(third, **kwargs):
    return pytest.mark.parametrize("running", [{"host": f"127.54.{third}.1", **kwargs}], indirect=True)


@at(1)
def test_streams_and_commands_pass_and_the_facts_are_told(running):
    running.start()
    running.say("autopilot1", attitude(1))
    for who in ("program1", "logger1", "gcs"):
        running.hears(who, attitude(1))
    running.say("program2", command(2, (2, 191)))
    running.hears("autopilot2", command(2, (2, 191)))
    running.say("tool", command(1, (253, 190)))
    running.hears("autopilot1", command(1, (253, 190)))
    running.say("autopilot1", ack((253, 190)))
    running.hears("tool", ack((253, 190)))
    running.say("autopilot2", heartbeat(2, armed=True, mode=OFFBOARD))
    running.told(lambda: running.facts.get("uav2.armed"), "the fact")
    assert running.facts["uav2.mode"] == "OFFBOARD"
    assert running.facts["uav1.armed"] is False
    running.told(lambda: running.stats.get("frames_to_vehicles") == 2, "the counts")
    running.process.send_signal(signal.SIGTERM)
    assert running.process.wait(DEADLINE_S) == 0


def hears_heartbeat(running, who, deadline_s):
    def look(left):
        if not select.select([running.sockets[who]], [], [], left)[0]:
            return None
        parsed = mavlink.MAVLink(None).parse_buffer(running.sockets[who].recv(65536)) or []
        return next((m for m in parsed if m.get_srcSystem() == 254), None)

    return wait_for(look, f"a ground station's heartbeat at {who}", deadline_s)


@at(2)
def test_the_heartbeat_of_a_ground_station_comes_once_a_second(running):
    beats = [hears_heartbeat(running, "autopilot2", DEADLINE_S) for _ in range(3)]
    times = [time.monotonic()]
    beats.append(hears_heartbeat(running, "autopilot2", DEADLINE_S))
    assert time.monotonic() - times[0] > 0.7
    assert {(m.get_srcComponent(), m.type) for m in beats} == {(190, mavlink.MAV_TYPE_GCS)}
    sequence = [m.get_seq() for m in beats]
    assert sequence == list(range(sequence[0], sequence[0] + 4))


@at(3)
def test_without_a_supervisor_it_serves_until_the_vehicles_are_disarmed_and_its_heartbeat_stops(running):
    running.start()
    running.say("autopilot1", heartbeat(1, armed=True))
    running.told(lambda: running.facts.get("uav1.armed"), "armed")
    running.line.close()
    with pytest.raises(AssertionError):
        for _ in range(4):  # one may be under way; then there is silence
            hears_heartbeat(running, "autopilot2", 2.5)
    assert running.process.poll() is None
    running.say("program1", command(1, (1, 191)))
    running.hears("autopilot1", command(1, (1, 191)))
    running.say("gcs", heartbeat(255, 190, kind=6))
    hears_heartbeat(running, "autopilot1", 3.0)
    running.say("autopilot1", heartbeat(1, armed=False))
    assert running.process.wait(DEADLINE_S) == 0


@at(6, real=(2,), simulated=False)
def test_it_is_ready_while_a_real_vehicle_is_switched_off(running):
    wait_for(lambda left: running.told_once() or running.say("autopilot1", heartbeat(1)), "readiness")
    assert "uav2.heard" not in running.facts


def test_an_orphan_serves_a_real_vehicle_until_it_is_disarmed_and_simulated_ones_for_a_minute():
    settings = slice_of((1, 2), host="127.54.7.1", real=(2,), simulated=False)
    shell = Shell(ProcessContext("router", settings, None), Table.from_slice(settings))

    def hear(k, armed):
        shell._router.on_datagram(
            shell._router.sockets.index(("127.54.7.1", 24001 + 10 * k)),
            ("127.54.7.1", 24000 + 10 * k),
            heartbeat(k, armed=armed),
            0.0,
        )

    try:
        hear(1, True)
        hear(2, True)
        assert not any(shell._is_over(True, now) for now in (0.0, 59.0, 61.0, 1e5))
        hear(2, False)
        assert not shell._is_over(True, 1e5 + 1)
        assert shell._is_over(True, 1e5 + 4), "uav1, simulated, died armed long ago"
    finally:
        shell.close()


@at(4)
def test_a_flood_of_garbage_and_of_a_dead_ground_station_does_not_stop_it(running):
    running.start()
    running.sockets.pop("gcs").close()  # its ICMP refusals must not reach a socket that serves others
    for _ in range(2000):
        running.say("tool", b"\xfd" * 1000)
        running.say("program1", os.urandom(60))
        running.say("autopilot1", attitude(1)[:-1])
    wait_for(
        lambda left: running.say("autopilot1", attitude(1)) or _hears(running, "program1", attitude(1)),
        "the stream",
    )
    assert running.process.poll() is None
    running.told(lambda: running.stats.get("dropped", {}).get("garbage bytes", 0) > 10_000, "the counts")


def _hears(running, who, data):
    with contextlib.suppress(AssertionError):
        running.hears(who, data, 0.2)
        return True
    return False


def test_a_port_in_use_is_one_clear_sentence(tmp_path):
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.54.5.1", 24011))
    file = tmp_path / "router.json"
    file.write_text(json.dumps(slice_of((1,), host="127.54.5.1")))
    done = subprocess.run(
        [sys.executable, "-m", "arena.mavlink_router", str(file)],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    taken.close()
    assert done.returncode == 1
    assert (
        done.stderr
        == "arena:router: the router cannot listen on UDP 127.54.5.1:24011: Address already in use\n"
    )


def test_one_that_is_never_heard_keeps_the_others_waiting_for_a_while_only_and_is_named():
    told = []
    room = types.SimpleNamespace(
        settings={},
        ready=lambda: told.append("ready"),
        event=told.append,
        orphaned=False,
        stats=lambda _: None,
    )
    shell = Shell(room, Table.from_slice(slice_of((1, 2), host="127.74.5.1")))
    try:
        now = time.monotonic()
        shell._tick(now + 9.0)
        assert told == []
        shell._tick(now + 11.0)
        shell._tick(now + 12.0)
    finally:
        shell.close()
    assert told == ["uav1, uav2 not heard for 10 s: the others need not wait", "ready"]
