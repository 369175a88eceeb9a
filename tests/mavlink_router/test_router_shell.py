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

from arena.mavlink_router.routing_table import Table
from arena.mavlink_router.shell import RouterShell
from arena.process_context import ProcessContext

DEADLINE_S = 60.0


def wait_for(condition, what, deadline_s=DEADLINE_S):
    end = time.monotonic() + deadline_s
    while time.monotonic() < end:
        if found := condition(end - time.monotonic()):
            return found
    raise AssertionError(f"{what} did not happen in {deadline_s} s")


class Running:
    """The router's process, its line to the supervisor (this test) and the sockets of all its neighbours."""

    def __init__(self, folder, host, **kwargs):
        self.slice = slice_of((1, 2), host=host, gcs=(host, 14550), recorder=(host, 24002), **kwargs)
        file = folder / "router.json"
        file.write_text(json.dumps(self.slice))
        self.sockets = {}
        for v in self.slice["vehicles"]:
            k = v["id"]
            self.open(f"autopilot{k}", v["link"]["remote"])
            self.open(f"program{k}", v["clients"][0]["address"])
        self.open("recorder", self.slice["recorder"])
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

    def send_as(self, who, data):
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

    def wait_received(self, who, data, deadline_s=DEADLINE_S):
        """Wait until `who` receives exactly these bytes."""

        def look(left):
            return (
                select.select([self.sockets[who]], [], [], left)[0] and self.sockets[who].recv(65536) == data
            )

        wait_for(look, f"{who} receiving {data!r}", deadline_s)

    def wait_reported(self, condition, what, deadline_s=DEADLINE_S):
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
        """Send heartbeats of both autopilots until the router is ready."""

        def send_heartbeats():
            for k in (1, 2):
                self.send_as(f"autopilot{k}", heartbeat(k))
            return self.is_ready

        wait_for(lambda left: self.ready_once() or send_heartbeats(), "readiness")

    def ready_once(self):
        with contextlib.suppress(AssertionError):
            self.wait_reported(lambda: self.is_ready, "readiness", 0.05)
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
def test_streams_and_commands_pass_and_facts_are_reported(running):
    running.start()
    running.send_as("autopilot1", attitude(1))
    for who in ("program1", "recorder", "gcs"):
        running.wait_received(who, attitude(1))
    running.send_as("program2", command(2, (2, 191)))
    running.wait_received("autopilot2", command(2, (2, 191)))
    running.send_as("tool", command(1, (253, 190)))
    running.wait_received("autopilot1", command(1, (253, 190)))
    running.send_as("autopilot1", ack((253, 190)))
    running.wait_received("tool", ack((253, 190)))
    running.send_as("autopilot2", heartbeat(2, armed=True, mode=OFFBOARD))
    running.wait_reported(lambda: running.facts.get("uav2.armed"), "the fact")
    assert running.facts["uav2.mode"] == "OFFBOARD"
    assert running.facts["uav1.armed"] is False
    running.wait_reported(lambda: running.stats.get("frames_to_vehicles") == 2, "the counts")
    running.process.send_signal(signal.SIGTERM)
    assert running.process.wait(DEADLINE_S) == 0


def next_heartbeat(running, who, deadline_s):
    def look(left):
        if not select.select([running.sockets[who]], [], [], left)[0]:
            return None
        parsed = mavlink.MAVLink(None).parse_buffer(running.sockets[who].recv(65536)) or []
        return next((m for m in parsed if m.get_srcSystem() == 254), None)

    return wait_for(look, f"a ground station's heartbeat at {who}", deadline_s)


@at(2)
def test_the_ground_station_heartbeat_is_sent_once_a_second(running):
    began = time.monotonic()
    beats = [next_heartbeat(running, "autopilot2", DEADLINE_S) for _ in range(4)]
    assert time.monotonic() - began > 2.0, "two of four may come at once, one late and the next in time"
    assert {(m.get_srcComponent(), m.type) for m in beats} == {(190, mavlink.MAV_TYPE_GCS)}
    sequence = [m.get_seq() for m in beats]
    assert sequence == list(range(sequence[0], sequence[0] + 4))


@at(15, real=(1, 2), needs_operator=(2,))
def test_heartbeat_depends_on_the_operator(running):  # review fault 20
    next_heartbeat(running, "autopilot1", DEADLINE_S)
    with pytest.raises(AssertionError):
        next_heartbeat(running, "autopilot2", 1.6)
    running.line.send(b'{"do": "operator"}')
    next_heartbeat(running, "autopilot2", DEADLINE_S)


@at(12, real=(1,))
def test_stop_signal_does_not_end_the_router_of_an_armed_real_vehicle(running):  # review fault 6
    running.start()
    for k in (1, 2):
        running.send_as(f"autopilot{k}", heartbeat(k, armed=True))
    running.wait_reported(lambda: running.facts.get("uav1.armed"), "the fact")
    running.process.send_signal(signal.SIGTERM)

    def refused(left):
        if not select.select([running.line], [], [], left)[0]:
            return None
        return "uav1 is armed: router continues" in json.loads(running.line.recv(65536)).get("event", "")

    wait_for(refused, "the report that the router continues")
    running.send_as("autopilot1", attitude(1))
    running.wait_received("program1", attitude(1))
    running.send_as("autopilot1", heartbeat(1, armed=False))
    assert running.process.wait(DEADLINE_S) == 0, "a simulated vehicle does not keep it running"


@at(3)
def test_an_orphan_serves_armed_vehicles_without_a_heartbeat(running):
    running.start()
    running.send_as("autopilot1", heartbeat(1, armed=True))
    running.wait_reported(lambda: running.facts.get("uav1.armed"), "armed")
    running.line.close()
    with pytest.raises(AssertionError):
        for _ in range(4):  # one may have been sent already; then there is silence
            next_heartbeat(running, "autopilot2", 1.6)
    assert running.process.poll() is None
    running.send_as("program1", command(1, (1, 191)))
    running.wait_received("autopilot1", command(1, (1, 191)))
    running.send_as("gcs", heartbeat(255, 190, kind=6))
    next_heartbeat(running, "autopilot1", 3.0)
    running.send_as("autopilot1", heartbeat(1, armed=False))
    assert running.process.wait(DEADLINE_S) == 0


@at(6, real=(2,), simulated=False)
def test_it_is_ready_while_a_real_vehicle_is_switched_off(running):
    wait_for(lambda left: running.ready_once() or running.send_as("autopilot1", heartbeat(1)), "readiness")
    assert "uav2.connected" not in running.facts


def test_an_orphan_serves_real_vehicles_longer_than_simulated_ones():
    settings = slice_of((1, 2), host="127.54.7.1", real=(2,), simulated=False)
    shell = RouterShell(ProcessContext("router", settings, None), Table.from_slice(settings))

    def receive(k, armed):
        shell._router.on_datagram(
            shell._router.sockets.index(("127.54.7.1", 24001 + 10 * k)),
            ("127.54.7.1", 24000 + 10 * k),
            heartbeat(k, armed=armed),
            0.0,
        )

    try:
        receive(1, True)
        receive(2, True)
        assert not any(shell._is_over(True, now) for now in (0.0, 59.0, 61.0, 1e5))
        receive(2, False)
        assert not shell._is_over(True, 1e5 + 1)
        assert shell._is_over(True, 1e5 + 4), "uav1, simulated, died armed long ago"
    finally:
        shell.close()


@at(4)
def test_a_flood_and_a_dead_ground_station_do_not_stop_the_router(running):
    running.start()
    running.sockets.pop("gcs").close()  # its ICMP refusals must not reach a socket that serves others
    for _ in range(2000):
        running.send_as("tool", b"\xfd" * 1000)
        running.send_as("program1", os.urandom(60))
        running.send_as("autopilot1", attitude(1)[:-1])
    wait_for(
        lambda left: (
            running.send_as("autopilot1", attitude(1)) or _received(running, "program1", attitude(1))
        ),
        "the stream",
    )
    assert running.process.poll() is None
    running.wait_reported(
        lambda: running.stats.get("dropped", {}).get("garbage bytes", 0) > 10_000, "the counts"
    )


def _received(running, who, data):
    with contextlib.suppress(AssertionError):
        running.wait_received(who, data, 0.2)
        return True
    return False


def test_a_port_in_use_is_an_error_in_one_sentence(tmp_path):
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
        == "arena:router: the router cannot listen on UDP 127.54.5.1:24011: Address already in use. Does another program use this port?\n"
    )


def test_a_missing_vehicle_is_named_and_the_others_start():
    reported = []
    process = types.SimpleNamespace(
        settings={},
        ready=lambda: reported.append("ready"),
        event=reported.append,
        orphaned=False,
        requests=list,
        audit=lambda entries: None,
        confirm=lambda request: None,
        operator_present=lambda now: False,
        stats=lambda _: None,
    )
    shell = RouterShell(process, Table.from_slice(slice_of((1, 2), host="127.74.5.1")))
    try:
        now = time.monotonic()
        shell._tick(now + 9.0)
        assert reported == []
        shell._tick(now + 11.0)
        shell._tick(now + 12.0)
    finally:
        shell.close()
    assert reported == ["uav1, uav2: no heartbeat for 10 s; starting the other vehicles", "ready"]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"requests": lambda: [{"do": "refuse_arming", "why": "the run is ending"}]}, "the run is ending"),
        ({"orphaned": True}, "the supervisor has ended"),
    ],
    ids=["stop signal", "supervisor lost"],
)
def test_arming_is_refused_from_the_first_stop_signal_on(changes, reason):  # review fault 6
    nothing = lambda *_: None  # noqa: E731
    given = {"settings": {}, "orphaned": False, "requests": list}
    calls = dict.fromkeys(
        ("ready", "event", "stats", "facts", "audit", "confirm", "operator_present"), nothing
    )
    table = Table.from_slice(slice_of((1,), host="127.74.5.2"))
    shell = RouterShell(types.SimpleNamespace(**{**given, **calls, **changes}), table)
    program = table.vehicles[0].clients[0]
    socket_ = shell._router.sockets.index(table.vehicles[0].serve)
    try:
        now = time.monotonic()
        arm = command(1, (1, 191))
        (before,) = shell._router.on_datagram(socket_, program, arm, now)
        assert before[1] == ((shell._router.links["uav1"], table.vehicles[0].remote),)
        shell._tick(now)
        ((reply, to),) = shell._router.on_datagram(socket_, program, arm, now)
        assert to == ((socket_, program),) and reason.encode() in bytes(reply)
    finally:
        shell.close()
