"""Tests that the open sockets of a running arena are exactly those of its plan."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from arena.plan.model import Plan
from arena.plan.open_ports import OpenSocket, open_sockets

from .flight import Flight, Hangar, eventually

pytestmark = pytest.mark.flight
Open = tuple[str, str, int]  # protocol, address, port; a local socket's port is 0


@pytest.fixture
def flight(hangar: Hangar) -> Iterator[Flight]:
    ids = (
        "--set",
        "vehicles.uav1.id=63",
        "--set",
        "vehicles.uav2.id=64",
    )  # not those that a real PX4 beside us may hold
    made = hangar.fly({"uav1": "hovers", "uav2": "hovers"}, *ids, more="copilot: {}\n")
    made.until_up(0.9)
    yield made
    assert made.cli("down", "--now").returncode in (0, 1)
    made.wait()


def bound(pid: int, *, alone: bool) -> set[Open]:
    """Return the UDP and listening TCP sockets of a process and, unless `alone`, of its children."""
    leader = psutil.Process(pid)
    found = set()
    for process in (leader, *(() if alone else leader.children(recursive=True))):
        for c in process.net_connections("inet"):
            if c.type == socket.SOCK_DGRAM or c.status == psutil.CONN_LISTEN:
                found.add(("udp" if c.type == socket.SOCK_DGRAM else "tcp", c.laddr.ip, c.laddr.port))
    return found


def local_sockets(folder: Path) -> set[Open]:
    return {("unix", str(p), 0) for p in folder.iterdir() if p.is_socket()}


def answers(opened: OpenSocket, found: Open) -> bool:
    """Return whether a socket is a planned port. Port 0 in the plan stands for any port chosen by the kernel."""
    protocol, address, port = found
    if opened.port or opened.protocol == "unix":
        return found == (opened.protocol, opened.address, opened.port)
    return protocol == opened.protocol and address in (opened.address, "0.0.0.0") and port >= 32768


def compare(planned: list[OpenSocket], found: set[Open]) -> tuple[set[Open], list[OpenSocket]]:
    """Return (unplanned, missing) sockets."""
    unplanned = {one for one in found if not any(answers(opened, one) for opened in planned)}
    missing = [
        opened for opened in planned if opened.always and not any(answers(opened, one) for one in found)
    ]
    return unplanned, missing


def test_open_sockets_match_the_plan(flight: Flight) -> None:
    text = (flight.folder / "plan.json").read_text().replace("{rt}", flight.state.rt)
    plan = Plan.from_json(text)
    state = flight.state
    pids = {
        "supervisor": state.supervisor.pid,
        **{name: member.pid for name, member in state.processes.items()},
    }
    assert set(pids) == {"supervisor", *(spec.name for spec in plan.processes)}
    every = [
        OpenSocket(**{**vars(opened), "address": opened.address.replace("{rt}", state.rt)})
        for opened in open_sockets(plan)
    ]

    def wrong() -> dict[str, object]:
        found = {}
        for name, pid in pids.items():
            own = bound(pid, alone=name == "supervisor")
            planned = [opened for opened in every if opened.process == name and opened.protocol != "unix"]
            if any(differences := compare(planned, own)):
                found[name] = differences
        here = [opened for opened in every if opened.protocol == "unix"]
        if any(differences := compare(here, local_sockets(Path(state.rt)))):
            found["local"] = differences
        return found

    eventually(lambda: not wrong(), 10, "the sockets of the plan", lambda: str(wrong()))
    assert all(opened.local for opened in every)
    assert Path(state.rt).stat().st_mode & 0o777 == 0o700, "what is in it is for the owner alone"


def test_socket_comparison_finds_missing_and_extra_sockets() -> None:
    one = OpenSocket(process="x", protocol="udp", address="127.0.0.1", port=5, what="", who="")
    some = OpenSocket(process="x", protocol="udp", address="127.0.0.1", port=0, what="", who="")
    assert compare([one, some], {("udp", "127.0.0.1", 5), ("udp", "127.0.0.1", 40000)}) == (set(), [])
    assert compare([one], {("udp", "0.0.0.0", 5)}) == ({("udp", "0.0.0.0", 5)}, [one])
    assert compare([some], {("udp", "192.168.1.5", 40000)}) == ({("udp", "192.168.1.5", 40000)}, [some])
    assert compare([some], {("udp", "127.0.0.1", 24016)}) == ({("udp", "127.0.0.1", 24016)}, [some])
