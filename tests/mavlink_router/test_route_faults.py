"""Links that are bad on purpose: the core with times of its own, and the process on a clock that this test moves."""

from __future__ import annotations

import math
import select
import socket
import time

import pytest
from fleet import Fleet, attitude, command, heartbeat, slice_of

from arena.clock import ClockServer
from arena.errors import InputError
from arena.fault_injection import inject
from arena.mavlink_router.__main__ import Shell
from arena.mavlink_router.link_impairment import LOST, ImpairedRouter
from arena.mavlink_router.router import TOOL_LIFE_S
from arena.mavlink_router.routing_table import Table
from arena.process_context import ProcessContext

PROGRAM1, PROGRAM2, STATION = (1, 191), (2, 191), (255, 190)
DEADLINE_S = 60.0


class Bad(Fleet):
    """A fleet whose router has `spoiled` before it. at: the time of delays [s]."""

    def __init__(self, seed=1):
        super().__init__()
        self.spoiled, self.at = ImpairedRouter(self.router, seed), 50.0

    def spoil(self, do, **fault):
        return self.spoiled.spoil({"do": do, **fault})

    def send(self, sender, socket, data):
        return self.named(self.spoiled.on_datagram(self.socket(socket), sender, data, self.now, self.at))

    def released(self, at):
        """{receiver: bytes} of what leaves at that time."""
        self.at = at
        return self.named(self.spoiled.release(self.now, at))

    def named(self, out):
        told = {}
        for piece, destinations in out:
            for _, dest in destinations:
                told[self.names[dest]] = told.get(self.names[dest], b"") + bytes(piece)
        return told


@pytest.fixture
def fleet():
    return Bad()


def test_a_link_that_loses_all_lets_nothing_pass_either_way_and_its_neighbour_is_as_ever(fleet):
    assert fleet.spoil("loss", vehicle="uav1", share=1) == "the link of uav1 loses 100 % each way"
    assert fleet.say("autopilot1", attitude(1)) == {}
    assert fleet.say("program1", command(1, PROGRAM1)) == {}
    assert set(fleet.say("autopilot2", attitude(2))) == {"program2", "sdk2", "logger2", "gcs"}
    assert fleet.say("program2", command(2, PROGRAM2)) == {"autopilot2": command(2, PROGRAM2)}
    assert set(fleet.say("gcs", command(0, STATION))) == {"autopilot2"}, "what is for both reaches the one"
    assert fleet.dropped == {LOST: 3}
    fleet.spoil("loss", vehicle="uav1", share=0)
    assert not fleet.spoiled.bad and "program1" in fleet.say("autopilot1", attitude(1))


def passed(seed, share=0.3, talk=True):
    """For 2000 datagrams each way of uav1, which pass; uav2 talks in between or not."""
    fleet = Bad(seed)
    for k in (1, 2):
        fleet.spoil("loss", vehicle=f"uav{k}", share=share)
    up, down = [], []
    for _ in range(2000):
        up.append(bool(fleet.say("program1", command(1, PROGRAM1))))
        if talk:
            fleet.say("autopilot2", attitude(2))
        down.append(bool(fleet.say("autopilot1", attitude(1))))
    return up, down


def test_a_share_is_lost_each_way_by_the_seed_alone():
    up, down = passed(7)
    assert sum(up) / 2000 == pytest.approx(0.7, abs=0.05) and sum(down) / 2000 == pytest.approx(0.7, abs=0.05)
    assert up != down
    assert passed(7, talk=False) == (up, down), "another link's traffic changes nothing"
    assert passed(8) != (up, down)


def test_a_delay_holds_both_ways_for_its_time_in_order(fleet):
    assert fleet.spoil("delay", vehicle="uav1", ms=200) == "the link of uav1 is 200 ms late each way"
    first, second = attitude(1), heartbeat(1)
    assert fleet.say("autopilot1", first) == {} and fleet.say("program1", command(1, PROGRAM1)) == {}
    assert fleet.say("autopilot2", attitude(2)) != {}, "the other link is in time"
    fleet.at = 50.1
    assert fleet.say("autopilot1", second) == {}
    assert fleet.spoiled.due == pytest.approx(50.2)
    assert fleet.released(50.199) == {}
    assert fleet.released(50.2) == {"autopilot1": command(1, PROGRAM1)} | dict.fromkeys(
        ("program1", "sdk1", "logger1", "gcs"), first
    )
    assert fleet.released(50.299) == {} and fleet.released(50.3)["program1"] == second
    assert fleet.spoiled.due is None


def test_what_is_held_is_a_copy(fleet):
    """The shell has one buffer for all datagrams."""
    fleet.spoil("delay", vehicle="uav1", ms=100)
    buffer = bytearray(attitude(1))
    fleet.say("autopilot1", buffer)
    buffer[:] = bytes(len(buffer))
    assert fleet.released(51.0)["program1"] == attitude(1)


def test_when_a_delay_ends_what_is_held_goes_first_and_nothing_overtakes(fleet):
    fleet.spoil("delay", vehicle="uav1", ms=500)
    first, second, third = command(1, PROGRAM1), heartbeat(*PROGRAM1, kind=18), command(1, (1, 192))
    for data, at in ((first, 50.0), (second, 50.3)):
        fleet.at = at
        assert fleet.say("program1", data) == {}
    fleet.at = 50.35
    fleet.spoil("delay", vehicle="uav1", ms=100)
    assert fleet.say("program1", third) == {}
    assert fleet.released(50.35) == {"autopilot1": first}
    fleet.spoil("delay", vehicle="uav1", ms=0)
    assert fleet.spoiled.bad, "two are held still"
    assert fleet.say("program1", first) == {}
    assert fleet.released(50.35) == {"autopilot1": second + third + first}
    assert not fleet.spoiled.bad and fleet.say("program1", second) == {"autopilot1": second}


def test_a_tool_is_answered_after_both_delays(fleet):
    fleet.spoil("delay", vehicle="uav1", ms=200)
    assert fleet.tool(command(1, (253, 190))) == {}
    assert fleet.released(50.2) == {"autopilot1": command(1, (253, 190))}
    fleet.now += TOOL_LIFE_S / 2
    fleet.say("autopilot1", attitude(1))
    assert "tool" in fleet.released(50.4)


def test_the_ground_stations_heartbeat_is_lost_with_its_link_and_muted_alone(fleet):
    beat = heartbeat(254, 190, kind=6)
    fleet.spoil("loss", vehicle="uav2", share=1.0)
    assert set(fleet.named(fleet.spoiled.outgoing(fleet.router.heartbeat(beat), fleet.at))) == {"autopilot1"}
    assert fleet.spoil("heartbeat", on=False) == "the ground station's heartbeat stops"
    assert fleet.spoiled.mute
    fleet.spoil("heartbeat", on=True)
    assert not fleet.spoiled.mute


LOSS, DELAY = {"do": "loss", "vehicle": "uav1", "share": 0.5}, {"do": "delay", "vehicle": "uav1", "ms": 10}
SENSELESS = [
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


@pytest.mark.parametrize("fault", SENSELESS, ids=str)
def test_a_fault_that_makes_no_sense_is_refused_and_changes_nothing(fleet, fault):
    with pytest.raises(InputError):
        fleet.spoiled.spoil(fault)
    assert not fleet.spoiled.bad and not fleet.spoiled.mute


class Running:
    """A router's shell in this thread, turned by hand, on a clock that this test moves."""

    def __init__(self, folder, third, with_clock=True, beats=False):
        host = f"127.61.2.{third}"
        self.slice = slice_of((1,), host=host, base=27000, gcs=(host, 14550), heartbeat=beats)
        self.slice |= {
            "faults": str(folder / "router.faults"),
            "clock": str(folder / "clock") if with_clock else None,
            "seed": 3,
        }
        v, self.told = self.slice["vehicles"][0], []
        self.autopilot, self.program = (
            self.open(a) for a in (v["link"]["remote"], v["clients"][0]["address"])
        )
        self.link, self.serve = tuple(v["link"]["local"]), tuple(v["serve"])
        self.clock, self.now = ClockServer(folder / "clock"), 10.0
        self.clock.tick(self.now)
        room = ProcessContext("router", self.slice, None)
        room.event = self.told.append
        self.shell = Shell(room, Table.from_slice(self.slice))

    def open(self, address):
        s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        s.bind(tuple(address))
        return s

    def turn(self, until, what):
        """Turn the router until something is so, time standing still."""
        end = time.monotonic() + DEADLINE_S
        while not until():
            assert time.monotonic() < end, f"{what}: not so in {DEADLINE_S:g} s"
            self.clock.poll()
            self.once()

    def once(self, patience_s=0.01):
        self.shell.turn(patience_s)

    def pass_time(self, until):
        """As a lockstep world does: a step whenever nobody is awake."""
        end = time.monotonic() + DEADLINE_S
        while self.now < until - 1e-9:
            assert time.monotonic() < end, f"time stands still at {self.now}"
            self.clock.poll()
            if self.clock.may_pass(self.now, 0.0):
                self.now = round(self.now + 0.004, 6)
                self.clock.tick(self.now)
            self.once(0.0)

    def hears(self, s):
        return s.recv(4096) if select.select([s], [], [], 0)[0] else None

    def spoil(self, **fault):
        inject("router.faults", fault)
        count = len(self.told) + 1
        self.turn(lambda: len(self.told) == count, f"{fault} told")

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
def test_a_delay_is_of_the_worlds_time_which_waits_for_the_router(running):
    running.spoil(do="delay", vehicle="uav1", ms=200)
    running.autopilot.sendto(attitude(1), running.link)
    running.turn(lambda: running.shell._spoiling._core.due, "held")
    assert running.shell._spoiling._core.due == pytest.approx(10.2)
    running.turn(lambda: any(s.gates for s in running.clock._sleepers.values()), "asleep on the clock")
    running.pass_time(10.196)
    assert running.hears(running.program) is None
    running.pass_time(10.204)
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "let go")
    assert running.now <= 10.2041 and running.hears(running.program) == attitude(1)
    running.program.sendto(command(1, PROGRAM1), running.serve)
    running.turn(lambda: running.shell._spoiling._core.due, "held")
    running.spoil(do="delay", vehicle="uav1", ms=0)
    assert running.hears(running.autopilot) == command(1, PROGRAM1)
    running.turn(lambda: not running.clock._sleepers, "no client of the clock without need")
    assert running.told == [
        "fault: the link of uav1 is 200 ms late each way",
        "fault: the link of uav1 is in time",
    ]


@pytest.mark.parametrize("running", [{"third": 2}], indirect=True)
def test_when_the_world_ends_what_was_held_goes_on(running):
    running.spoil(do="delay", vehicle="uav1", ms=200)
    running.autopilot.sendto(attitude(1), running.link)
    running.turn(lambda: running.shell._spoiling._core.due, "held")
    running.clock.close()
    running.clock = ClockServer("another")
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "let go")
    assert running.hears(running.program) == attitude(1)
    assert (
        running.told[-1] == "no more delays on purpose: the world that serves the simulation clock has ended"
    )
    running.autopilot.sendto(heartbeat(1), running.link)
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "in time again")


@pytest.mark.parametrize("running", [{"third": 3, "with_clock": False}], indirect=True)
def test_without_a_worlds_clock_a_delay_is_of_the_walls_time(running):
    running.spoil(do="delay", vehicle="uav1", ms=150)
    sent = time.monotonic()
    running.autopilot.sendto(attitude(1), running.link)
    running.turn(lambda: select.select([running.program], [], [], 0)[0], "let go")
    assert time.monotonic() - sent >= 0.15
    running.spoil(do="delay", vehicle="nobody", ms=150)
    assert running.told[-1].startswith("fault refused: ")


@pytest.mark.parametrize("running", [{"third": 5, "beats": True}], indirect=True)
def test_in_a_world_faster_than_the_wall_the_ground_station_is_heard_once_a_second_of_its_time(running):
    running.turn(lambda: running.hears(running.autopilot), "the first heartbeat")
    while running.hears(running.autopilot):
        pass
    running.shell._next_second = math.inf  # the wall's
    running.pass_time(running.now + 5.0)
    beats = 0
    while running.hears(running.autopilot):
        beats += 1
    assert 4 <= beats <= 5


@pytest.mark.parametrize("running", [{"third": 4, "beats": True}], indirect=True)
def test_a_muted_heartbeat_is_not_sent_and_comes_back(running):
    def beats():
        running.shell._next_second = 0.0
        running.shell._tick(time.monotonic())
        return running.hears(running.autopilot)

    assert beats() is not None
    running.spoil(do="heartbeat", on=False)
    assert beats() is None
    running.spoil(do="heartbeat", on=True)
    assert beats() is not None
