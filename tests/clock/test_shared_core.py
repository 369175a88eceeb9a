"""The world and its only client sleep on one core, and may use all their cores while they are awake."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from arena import shared_core
from arena.clock import SimClock
from arena.clock_server import ClockServer
from arena.errors import RunError

CORES = {2, 3, 5}


class Cores:
    """Stand-in of the kernel's table of cores that each thread may use. log: (thread, cores) of each change."""

    def __init__(self) -> None:
        self._all: dict[int, set[int]] = {}
        self.log: list[tuple[int, set[int]]] = []

    def get(self, pid: int) -> set[int]:
        assert pid == 0
        return set(self._all.get(threading.get_ident(), CORES))

    def set(self, pid: int, cores: Iterable[int]) -> None:
        assert pid == 0
        self._all[threading.get_ident()] = set(cores)
        self.log.append((threading.get_ident(), set(cores)))


@pytest.fixture
def cores(monkeypatch: pytest.MonkeyPatch) -> Cores:
    made = Cores()
    monkeypatch.setattr(os, "sched_getaffinity", made.get)
    monkeypatch.setattr(os, "sched_setaffinity", made.set)
    monkeypatch.setattr(shared_core, "present_core", lambda: 3)
    monkeypatch.setattr("arena.clock_server.present_core", lambda: 3)
    return made


@pytest.fixture
def server(tmp_path: Path, cores: Cores) -> Iterator[ClockServer]:
    made = ClockServer(tmp_path / "clock", lockstep=True)
    yield made
    made.close()


def sleeper(clock: SimClock, until_s: float, found: list[object]) -> threading.Thread:
    """Start a thread that sleeps on the clock, and stores the time or the error, and its cores after the sleep."""

    def work() -> None:
        try:
            found.append(clock.sleep_only(until_s))
        except RunError as error:
            found.append(error)
        found.append(os.sched_getaffinity(0))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread


def until_asleep(server: ClockServer, clients: int = 1) -> None:
    for _ in range(500):
        if len(server.asleep) == clients:
            return
        server.poll(0.1)
    raise AssertionError("the client does not sleep")


def wake(server: ClockServer, now: float, thread: threading.Thread) -> None:
    until_asleep(server)
    server.tick(now)
    thread.join(60)


def test_core_is_kept_only_between_stay_on_and_leave(cores: Cores) -> None:
    before = shared_core.stay_on(5)
    assert os.sched_getaffinity(0) == {5}
    shared_core.leave(before)
    assert os.sched_getaffinity(0) == CORES


def test_foreign_or_only_core_changes_nothing(cores: Cores) -> None:
    assert shared_core.stay_on(4) is None, "the thread may not use it"
    cores.set(0, {5})
    assert shared_core.stay_on(5) is None, "the thread has no other core"
    shared_core.leave(None)
    assert os.sched_getaffinity(0) == {5}


def test_only_client_sleeps_on_the_core_of_the_world(
    server: ClockServer, cores: Cores, tmp_path: Path
) -> None:
    clock, found = SimClock(tmp_path / "clock", "program"), []
    first = sleeper(clock, 0.5, found)
    wake(server, 0.5, first)
    assert found == [0.5, CORES] and cores.log == [], "the world has not woken it before"
    second = sleeper(clock, 1.0, found)
    wake(server, 1.0, second)
    assert found[2:] == [1.0, CORES]
    assert [set_to for _, set_to in cores.log] == [{3}, CORES]


class HeldClock(SimClock):
    """Clock of a program that is preempted directly after its request, until the world has replied."""

    def __init__(self, path: Path, replied: threading.Event) -> None:
        super().__init__(path, "program")
        self._replied = replied

    def request_wake(self, t: float) -> None:
        super().request_wake(t)
        assert self._replied.wait(60)


def test_core_counts_from_the_request_on(server: ClockServer, cores: Cores, tmp_path: Path) -> None:
    replied, found = threading.Event(), []
    thread = sleeper(HeldClock(tmp_path / "clock", replied), 0.5, found)
    until_asleep(server)
    server.tick(0.5)
    replied.set()
    thread.join(60)
    assert found == [0.5, CORES] and cores.log == [], "the reply publishes the core for the next sleep"


def test_world_waits_for_its_only_client_on_its_core(
    server: ClockServer, cores: Cores, tmp_path: Path
) -> None:
    clock = SimClock(tmp_path / "clock", "program")
    clock.request_wake(0.5)
    until_asleep(server)
    server.tick(0.5)
    assert clock.wait_for_wake(10.0) == 0.5
    clock.request_wake(1.0)
    assert server.wait_for_requests(10.0)
    assert [set_to for _, set_to in cores.log] == [{3}, CORES]
    assert os.sched_getaffinity(0) == CORES


def test_two_clients_use_all_cores(server: ClockServer, cores: Cores, tmp_path: Path) -> None:
    clocks = [SimClock(tmp_path / "clock", name) for name in ("uav1", "uav2")]
    for now in (0.5, 1.0):
        for clock in clocks:
            clock.request_wake(now)
        until_asleep(server, 2)
        server.tick(now)
        assert [clock.wait_for_wake(10.0) for clock in clocks] == [now, now]
        server.wait_for_requests(0.001)
    assert cores.log == []


def test_end_of_the_world_gives_all_cores_back(server: ClockServer, cores: Cores, tmp_path: Path) -> None:
    clock, found = SimClock(tmp_path / "clock", "program"), []
    wake(server, 0.5, sleeper(clock, 0.5, found))
    thread = sleeper(clock, 1.0, found)
    until_asleep(server)
    server.close()
    thread.join(60)
    assert isinstance(found[2], RunError) and found[3] == CORES
    assert [set_to for _, set_to in cores.log] == [{3}, CORES]


def test_clock_that_follows_the_wall_clock_uses_all_cores(cores: Cores, tmp_path: Path) -> None:
    server = ClockServer(tmp_path / "clock")
    clock = SimClock(tmp_path / "clock", "program")
    for now in (0.5, 1.0):
        clock.request_wake(now)
        until_asleep(server)
        server.tick(now)
        assert clock.wait_for_wake(10.0) == now
    clock.close()
    server.close()
    assert cores.log == []


def test_present_core_is_one_of_the_own() -> None:
    own = os.sched_getaffinity(0)
    assert shared_core.present_core() in (own if len(own) > 1 else {shared_core.NO_CORE})
