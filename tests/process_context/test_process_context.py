"""The socket to the supervisor, and the end of a process whose supervisor has died."""

from __future__ import annotations

import json
import os
import socket
from functools import partial

import pytest

from arena.errors import InputError, RunError
from arena.process_context import (
    SOCKET_VARIABLE,
    ProcessContext,
    ShutdownPolicy,
    run_process,
    supervisor_socket,
)


@pytest.fixture
def line():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(2)
    theirs.setblocking(False)
    yield ours, theirs
    ours.close()
    theirs.close()


def test_facts_stats_and_events_are_one_packet_each(line):
    ours, theirs = line
    room = ProcessContext("x", {}, theirs)
    room.ready(**{"uav1.armed": False})
    room.stats({"rate_hz": 60.0})
    room.event("hello")
    assert json.loads(ours.recv(4096)) == {"ready": True, "facts": {"uav1.armed": False}}
    assert json.loads(ours.recv(4096)) == {"stats": {"rate_hz": 60.0}}
    assert json.loads(ours.recv(4096)) == {"event": "hello"}


def test_death_of_the_supervisor_is_detected(line):
    ours, theirs = line
    room = ProcessContext("x", {}, theirs)
    assert not room.orphaned
    ours.close()
    assert room.orphaned
    assert room.orphaned


def test_requests_of_the_supervisor_are_received_once(line):
    ours, theirs = line
    room = ProcessContext("x", {}, theirs)
    ours.send(json.dumps({"do": "refuse_arming", "why": "the run is ending"}).encode())
    ours.send(b"not json")
    assert not room.orphaned
    assert room.requests() == [{"do": "refuse_arming", "why": "the run is ending"}]
    assert room.requests() == [] and not room.orphaned


def test_stopped_supervisor_does_not_block_a_process(line):
    _, theirs = line
    room = ProcessContext("x", {}, theirs)
    for _ in range(10_000):
        room.stats({"n": 1})
    assert room.unsent > 0


def test_facts_of_the_time_of_a_stopped_supervisor_are_sent_later(line):
    """The supervisor restores the refusals of a router from its facts, which are sent only when they change."""
    ours, theirs = line
    room = ProcessContext("x", {}, theirs)
    while not room.unsent:
        room.stats({"n": 1})
    room.facts({"uav1.armed": False, "uav1.standing": {}})
    room.ready(**{"uav1.armed": True})
    room.facts({"uav1.standing": {"latch": [4, 3]}})
    ours.setblocking(False)
    with pytest.raises(BlockingIOError):
        while True:
            assert "facts" not in json.loads(ours.recv(4096))
    room.stats({"n": 2})
    facts = {"uav1.armed": True, "uav1.standing": {"latch": [4, 3]}}
    assert json.loads(ours.recv(4096)) == {"ready": True, "facts": facts}
    assert json.loads(ours.recv(4096)) == {"stats": {"n": 2}}
    with pytest.raises(BlockingIOError):
        ours.recv(4096)


def test_process_without_supervisor_is_no_orphan():
    room = ProcessContext("x", {}, None)
    room.ready()
    assert not room.supervised
    assert not room.orphaned


def test_socket_variable_is_removed_from_the_environment(line, monkeypatch):
    _, theirs = line
    monkeypatch.setenv(SOCKET_VARIABLE, str(os.dup(theirs.fileno())))
    taken = supervisor_socket()
    assert taken is not None
    assert SOCKET_VARIABLE not in os.environ
    assert not taken.get_inheritable()
    taken.close()


def test_missing_slice_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="no_such"):
        ProcessContext.enter([str(tmp_path / "no_such.json")])


@pytest.mark.parametrize(
    ("make", "code", "said"),
    [
        (lambda room: lambda: None, 0, ""),
        (lambda room: lambda: 3, 3, ""),
        (
            lambda room: room.settings["hz"],
            2,
            "x: configuration file of x.uav1: the key 'hz' is missing. "
            "`arena up` writes this file; its keys are in docs/reference/slices.md\n",
        ),
        (lambda room: partial(fail, RunError("the port is taken")), 1, "x: the port is taken\n"),
    ],
)
def test_error_becomes_one_line_and_its_exit_code(make, code, said, monkeypatch, capsys):
    monkeypatch.setattr(ProcessContext, "enter", lambda argv=None: ProcessContext("x.uav1", {}, None))
    assert run_process("x", make) == code
    assert capsys.readouterr().err == said


def test_key_error_while_serving_is_not_a_missing_slice_key(monkeypatch):
    monkeypatch.setattr(ProcessContext, "enter", lambda argv=None: ProcessContext("x.uav1", {}, None))
    with pytest.raises(KeyError):
        run_process("x", lambda room: partial(fail, KeyError("a mistake")))


def fail(error):
    raise error


def test_orphan_serves_until_its_vehicles_are_disarmed():
    after = ShutdownPolicy(limit_s=60.0, settle_s=2.0)
    assert not after.over(orphaned=False, any_armed=True, now=0.0)
    assert not after.over(orphaned=True, any_armed=True, now=10.0)
    assert not after.over(orphaned=True, any_armed=False, now=20.0)
    assert not after.over(orphaned=True, any_armed=True, now=21.0)
    assert not after.over(orphaned=True, any_armed=False, now=23.0)
    assert after.over(orphaned=True, any_armed=False, now=25.1)


def test_only_simulated_orphans_end_after_the_limit():
    simulated, real = ShutdownPolicy(limit_s=60.0), ShutdownPolicy(limit_s=None)
    for after in (simulated, real):
        assert not after.over(orphaned=True, any_armed=True, now=0.0)
    assert simulated.over(orphaned=True, any_armed=True, now=60.0)
    assert not real.over(orphaned=True, any_armed=True, now=1e6)


def test_stop_signal_does_not_end_a_process_that_serves_an_armed_vehicle(line):  # review fault 6
    ours, theirs = line
    room = ProcessContext("link.uav1", {}, theirs)
    assert not room.may_end([]), "no stop signal yet"
    room.stopping = True
    assert not room.may_end(["uav1"]) and not room.may_end(["uav1"])
    said = json.loads(ours.recv(4096))["event"]
    assert (
        said == "stop signal received, but uav1 is armed: link.uav1 continues until the vehicle is disarmed"
    )
    ours.setblocking(False)
    with pytest.raises(BlockingIOError):
        ours.recv(4096)
    assert room.may_end([])


def test_process_does_not_wait_for_a_vehicle_declared_dead(line):  # review fault 18
    ours, theirs = line
    room = ProcessContext("router", {}, theirs)
    room.stopping = True
    ours.send(json.dumps({"do": "forget", "vehicle": "uav1"}).encode())
    assert room.may_end(["uav1"]) and not room.may_end(["uav1", "uav2"])
    assert room.requests() == []
