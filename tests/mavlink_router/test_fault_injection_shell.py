"""Links that lose and delay datagrams: the pure core with times of the test, and the shell on a clock that the test advances."""

from __future__ import annotations

import math
import select
import socket
import time

import pytest
from fleet import Fleet, attitude, command, heartbeat, slice_of

from arena.clock_server import ClockServer
from arena.errors import InputError
from arena.fault_injection import inject
from arena.mavlink_router.__main__ import make_shell
from arena.mavlink_router.link_impairment import LOST, ImpairedRouter
from arena.mavlink_router.router import TOOL_TIMEOUT_S
from arena.mavlink_router.shell import RouterShell
from arena.process_context import ProcessContext

PROGRAM1, PROGRAM2, GCS_ID = (1, 191), (2, 191), (255, 190)
DEADLINE_S = 60.0


class ImpairedFleet(Fleet):
    """A fleet behind an impaired router. at: time that delays are measured on [s]."""

    def __init__(self, seed=1):
        super().__init__()
        self.impaired, self.at = ImpairedRouter(self.router, seed), 50.0

    def inject(self, do, **fault):
        return self.impaired.apply({"do": do, **fault})

    def send(self, sender, socket, data):
        return self.named(self.impaired.on_datagram(self.socket(socket), sender, data, self.now, self.at))

    def released(self, at):
        """Return {receiver: bytes} of what leaves at that time."""
        self.at = at
        return self.named(self.impaired.release(self.now, at))


@pytest.fixture
def fleet():
    return ImpairedFleet()


def test_full_loss_stops_one_link_and_no_other(fleet):
    assert fleet.inject("loss", vehicle="uav1", share=1) == "the link of uav1 loses 100 % in each direction"
    assert fleet.send_as("autopilot1", attitude(1)) == {}
    assert fleet.send_as("program1", command(1, PROGRAM1)) == {}
    assert set(fleet.send_as("autopilot2", attitude(2))) == {"program2", "sdk2", "recorder", "gcs"}
    assert fleet.send_as("program2", command(2, PROGRAM2)) == {"autopilot2": command(2, PROGRAM2)}
    assert set(fleet.send_as("gcs", command(0, GCS_ID))) == {"autopilot2"}, "what is for both reaches the one"
    assert fleet.dropped == {LOST: 3}
    fleet.inject("loss", vehicle="uav1", share=0)
    assert not fleet.impaired.active and "program1" in fleet.send_as("autopilot1", attitude(1))


def passed(seed, share=0.3, traffic=True):
    """Return for 1000 datagrams in each direction of uav1 which pass; with traffic of uav2 in between or not."""
    fleet = ImpairedFleet(seed)
    for k in (1, 2):
        fleet.inject("loss", vehicle=f"uav{k}", share=share)
    up, down = [], []
    for _ in range(1000):
        up.append(bool(fleet.send_as("program1", command(1, PROGRAM1))))
        if traffic:
            fleet.send_as("autopilot2", attitude(2))
        down.append(bool(fleet.send_as("autopilot1", attitude(1))))
    return up, down


def test_losses_depend_on_the_seed_only():
    up, down = passed(7)
    assert sum(up) / 1000 == pytest.approx(0.7, abs=0.05) and sum(down) / 1000 == pytest.approx(0.7, abs=0.05)
    assert up != down
    assert passed(7, traffic=False) == (up, down), "another link's traffic changes nothing"
    assert passed(8) != (up, down)


def test_a_delay_keeps_the_order_in_both_directions(fleet):
    assert (
        fleet.inject("delay", vehicle="uav1", ms=200)
        == "the link of uav1 is delayed by 200 ms in each direction"
    )
    first, second = attitude(1), heartbeat(1)
    assert fleet.send_as("autopilot1", first) == {} and fleet.send_as("program1", command(1, PROGRAM1)) == {}
    assert fleet.send_as("autopilot2", attitude(2)) != {}, "the other link is in time"
    fleet.at = 50.1
    assert fleet.send_as("autopilot1", second) == {}
    assert fleet.impaired.due == pytest.approx(50.2)
    assert fleet.released(50.199) == {}
    assert fleet.released(50.2) == {"autopilot1": command(1, PROGRAM1)} | dict.fromkeys(
        ("program1", "sdk1", "recorder", "gcs"), first
    )
    assert fleet.released(50.299) == {} and fleet.released(50.3)["program1"] == second
    assert fleet.impaired.due is None


def test_a_delayed_datagram_is_a_copy(fleet):
    """The shell receives all datagrams into one buffer."""
    fleet.inject("delay", vehicle="uav1", ms=100)
    buffer = bytearray(attitude(1))
    fleet.send_as("autopilot1", buffer)
    buffer[:] = bytes(len(buffer))
    assert fleet.released(51.0)["program1"] == attitude(1)


def test_the_end_of_a_delay_keeps_the_order(fleet):
    fleet.inject("delay", vehicle="uav1", ms=500)
    first, second, third = command(1, PROGRAM1), heartbeat(*PROGRAM1, kind=18), command(1, (1, 192))
    for data, at in ((first, 50.0), (second, 50.3)):
        fleet.at = at
        assert fleet.send_as("program1", data) == {}
    fleet.at = 50.35
    fleet.inject("delay", vehicle="uav1", ms=100)
    assert fleet.send_as("program1", third) == {}
    assert fleet.released(50.35) == {"autopilot1": first}
    fleet.inject("delay", vehicle="uav1", ms=0)
    assert fleet.impaired.active, "two are held still"
    assert fleet.send_as("program1", first) == {}
    assert fleet.released(50.35) == {"autopilot1": second + third + first}
    assert not fleet.impaired.active and fleet.send_as("program1", second) == {"autopilot1": second}


def test_a_tool_is_answered_after_both_delays(fleet):
    fleet.inject("delay", vehicle="uav1", ms=200)
    assert fleet.tool(command(1, (253, 190))) == {}
    assert fleet.released(50.2) == {"autopilot1": command(1, (253, 190))}
    fleet.now += TOOL_TIMEOUT_S / 2
    fleet.send_as("autopilot1", attitude(1))
    assert "tool" in fleet.released(50.4)


def test_the_heartbeat_is_lost_with_a_link_and_can_be_muted_alone(fleet):
    beat = heartbeat(254, 190, kind=6)
    fleet.inject("loss", vehicle="uav2", share=1.0)
    assert set(fleet.named(fleet.impaired.outgoing(fleet.router.heartbeat(beat), fleet.at))) == {"autopilot1"}
    assert fleet.inject("heartbeat", on=False) == "the ground station's heartbeat is not sent"
    assert fleet.impaired.muted
    fleet.inject("heartbeat", on=True)
    assert not fleet.impaired.muted


LOSS, DELAY = {"do": "loss", "vehicle": "uav1", "share": 0.5}, {"do": "delay", "vehicle": "uav1", "ms": 10}
INVALID = [
    {},
    {"do": "lose"},
    {"do": None},
    {**LOSS, "vehicle": "uav3"},
    {**LOSS, "vehicle": None},
    {**LOSS, "share": 1.01},
    {**LOSS, "share": float("nan")},
    {"do": "loss", "vehicle": "uav1"},
    {**DELAY, "ms": -1},
    {**DELAY, "ms": float("inf")},
    {**DELAY, "ms": "10"},
    {"do": "heartbeat"},
    {"do": "heartbeat", "on": 0},
]


@pytest.mark.parametrize("fault", INVALID, ids=str)
def test_an_invalid_fault_is_refused_and_changes_nothing(fleet, fault):
    with pytest.raises(InputError):
        fleet.impaired.apply(fault)
    assert not fleet.impaired.active and not fleet.impaired.muted


class Running:
    """A router's shell in this thread, on a clock that the test advances."""

    def __init__(self, folder, third, with_clock=True, beats=False):
        host = f"127.61.2.{third}"
        self.slice = slice_of((1,), host=host, base=27000, gcs=(host, 14550), heartbeat=beats)
        self.slice |= {
            "faults": str(folder / "router.faults"),
            "clock": str(folder / "clock") if with_clock else None,
            "seed": 3,
        }
        v, self.events = self.slice["vehicles"][0], []
        self.autopilot, self.program = (
            self.open(a) for a in (v["link"]["remote"], v["clients"][0]["address"])
        )
        self.link, self.serve = tuple(v["link"]["local"]), tuple(v["serve"])
        self.clock, self.now = ClockServer(folder / "clock"), 10.0
        self.clock.tick(self.now)
        process = ProcessContext("router", self.slice, None)
        process.event = self.events.append
        self.shell = make_shell(process)

    def open(self, address):
        s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        s.bind(tuple(address))
        return s

    def turn(self, until, what):
        """Turn the router until a condition holds; simulation time stands still."""
        end = time.monotonic() + DEADLINE_S
        while not until():
            assert time.monotonic() < end, f"{what}: not within {DEADLINE_S:g} s"
            self.clock.poll()
            self.once()

    def once(self, patience_s=0.01):
        self.shell.turn(patience_s)

    def pass_time(self, until):
        """Advance time as a lockstep world does: a step whenever no client is awake."""
        end = time.monotonic() + DEADLINE_S
        while self.now < until - 1e-9:
            assert time.monotonic() < end, f"time stands still at {self.now}"
            self.clock.poll()
            if self.clock.may_advance(self.now, 0.0):
                self.now = round(self.now + 0.004, 6)
                self.clock.tick(self.now)
            self.once(0.0)

    def received(self, s):
        return s.recv(4096) if select.select([s], [], [], 0)[0] else None

    def inject(self, **fault):
        inject("router.faults", fault)
        count = len(self.events) + 1
        self.turn(lambda: len(self.events) == count, f"{fault} reported")

    def close(self):
        self.shell.close()
        self.clock.close()
        for s in (self.autopilot, self.program):
            s.close()


@pytest.fixture
def running(tmp_path, monkeypatch, request):
    monkeypatch.chdir(tmp_path)
    made = Running(tmp_path, **request.param)
    yield made
    made.close()
    assert not (tmp_path / "router.faults").exists()


@pytest.mark.parametrize("running", [{"third": 1}], indirect=True)
def test_a_delay_is_in_simulation_time_which_waits_for_the_router(running):
    running.inject(do="delay", vehicle="uav1", ms=200)
    running.autopilot.sendto(attitude(1), running.link)
    running.turn(lambda: running.shell.impaired.due, "held")
    assert running.shell.impaired.due == pytest.approx(10.2)
    running.turn(lambda: any(s.gates for s in running.clock._clients.values()), "asleep on the clock")
    running.pass_time(10.196)
    assert running.received(running.program) is None
    running.pass_time(10.204)
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "let go")
    assert running.now <= 10.2041 and running.received(running.program) == attitude(1)
    running.program.sendto(command(1, PROGRAM1), running.serve)
    running.turn(lambda: running.shell.impaired.due, "held")
    running.inject(do="delay", vehicle="uav1", ms=0)
    assert running.received(running.autopilot) == command(1, PROGRAM1)
    running.turn(lambda: not running.clock._clients, "no client of the clock without need")
    assert running.events == [
        "fault: the link of uav1 is delayed by 200 ms in each direction",
        "fault: the link of uav1 is not delayed",
    ]


@pytest.mark.parametrize("running", [{"third": 2}], indirect=True)
def test_delayed_datagrams_leave_when_the_world_ends(running):
    running.inject(do="delay", vehicle="uav1", ms=200)
    running.autopilot.sendto(attitude(1), running.link)
    running.turn(lambda: running.shell.impaired.due, "held")
    running.clock.close()
    running.clock = ClockServer("another")
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "let go")
    assert running.received(running.program) == attitude(1)
    assert (
        running.events[-1]
        == "fault injection: no simulation clock for delays (the world that serves the simulation clock has ended). "
        "Loss and delay of all links are set to 0"
    )
    running.autopilot.sendto(heartbeat(1), running.link)
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "in time again")


@pytest.mark.parametrize("running", [{"third": 3, "with_clock": False}], indirect=True)
def test_without_a_simulation_clock_a_delay_is_in_wall_time(running):
    running.inject(do="delay", vehicle="uav1", ms=150)
    sent = time.monotonic()
    running.autopilot.sendto(attitude(1), running.link)
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "let go")
    assert time.monotonic() - sent >= 0.15
    running.inject(do="delay", vehicle="nobody", ms=150)
    assert running.events[-1].startswith("fault refused: ")


@pytest.mark.parametrize("running", [{"third": 5, "beats": True}], indirect=True)
def test_a_fast_world_gets_a_heartbeat_per_second_of_its_time(running):
    running.turn(lambda: running.received(running.autopilot), "the first heartbeat")
    while running.received(running.autopilot):
        pass
    running.shell._next_second = math.inf  # the wall's
    running.pass_time(running.now + 5.0)
    beats = 0
    while running.received(running.autopilot):
        beats += 1
    assert 4 <= beats <= 5


@pytest.mark.parametrize("running", [{"third": 4, "beats": True}], indirect=True)
def test_a_muted_heartbeat_is_not_sent_and_comes_back(running):
    def beats():
        running.shell._next_second = 0.0
        running.shell._tick(time.monotonic())
        return running.received(running.autopilot)

    assert beats() is not None
    running.inject(do="heartbeat", on=False)
    assert beats() is None
    running.inject(do="heartbeat", on=True)
    assert beats() is not None


def test_a_router_without_faults_has_no_fault_injection():
    settings = slice_of((1,), host="127.61.2.9", base=27000)
    shell = make_shell(ProcessContext("router", settings, None))
    try:
        assert type(shell) is RouterShell and shell._route == shell._router.on_datagram
    finally:
        shell.close()


@pytest.mark.parametrize("running", [{"third": 6}], indirect=True)
def test_datagrams_pass_the_impaired_router_only_while_a_fault_is_active(running):
    plain = running.shell._router.on_datagram
    assert running.shell._route == plain
    running.inject(do="loss", vehicle="uav1", share=0.5)
    assert running.shell._route != plain
    running.inject(do="loss", vehicle="uav1", share=0.0)
    assert running.shell._route == plain
