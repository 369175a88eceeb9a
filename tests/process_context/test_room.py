"""The line to the supervisor, and when a room may end without it."""

from __future__ import annotations

import json
import os
import socket
from functools import partial

import pytest

from arena.errors import InputError, RunError
from arena.process_context import SOCKET_VARIABLE, ProcessContext, ShutdownPolicy, run_room, supervisor_socket


@pytest.fixture
def line():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(2)
    theirs.setblocking(False)
    yield ours, theirs
    ours.close()
    theirs.close()


def test_what_a_room_tells_arrives_packet_by_packet(line):
    ours, theirs = line
    room = ProcessContext("x", {}, theirs)
    room.ready(**{"uav1.armed": False})
    room.stats({"rate_hz": 60.0})
    room.event("hello")
    assert json.loads(ours.recv(4096)) == {"ready": True, "facts": {"uav1.armed": False}}
    assert json.loads(ours.recv(4096)) == {"stats": {"rate_hz": 60.0}}
    assert json.loads(ours.recv(4096)) == {"event": "hello"}


def test_the_end_of_the_supervisor_is_noticed(line):
    ours, theirs = line
    room = ProcessContext("x", {}, theirs)
    assert not room.orphaned
    ours.close()
    assert room.orphaned
    assert room.orphaned


def test_a_stopped_supervisor_never_blocks_a_room(line):
    _, theirs = line
    room = ProcessContext("x", {}, theirs)
    for _ in range(10_000):
        room.stats({"n": 1})
    assert room.unsent > 0


def test_alone_a_room_tells_nobody_and_is_no_orphan():
    room = ProcessContext("x", {}, None)
    room.ready()
    assert not room.supervised
    assert not room.orphaned


def test_the_line_is_taken_out_of_the_environment_so_that_grandchildren_do_not_hold_it(line, monkeypatch):
    _, theirs = line
    monkeypatch.setenv(SOCKET_VARIABLE, str(os.dup(theirs.fileno())))
    taken = supervisor_socket()
    assert taken is not None
    assert SOCKET_VARIABLE not in os.environ
    assert not taken.get_inheritable()
    taken.close()


def test_a_missing_slice_is_a_sentence(tmp_path):
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
            "x: the slice of x.uav1: 'hz' is missing (docs/architecture.md, Slices)\n",
        ),
        (lambda room: partial(fail, RunError("the port is taken")), 1, "x: the port is taken\n"),
    ],
)
def test_a_room_ends_with_one_line_and_the_code_of_what_went_wrong(make, code, said, monkeypatch, capsys):
    monkeypatch.setattr(ProcessContext, "enter", lambda argv=None: ProcessContext("x.uav1", {}, None))
    assert run_room("x", make) == code
    assert capsys.readouterr().err == said


def test_a_mistake_while_serving_is_not_taken_for_a_slice_that_lacks_a_key(monkeypatch):
    monkeypatch.setattr(ProcessContext, "enter", lambda argv=None: ProcessContext("x.uav1", {}, None))
    with pytest.raises(KeyError):
        run_room("x", lambda room: partial(fail, KeyError("a mistake")))


def fail(error):
    raise error


def test_an_orphan_serves_until_its_vehicles_are_disarmed_for_a_while():
    after = ShutdownPolicy(limit_s=60.0, settle_s=2.0)
    assert not after.over(orphaned=False, any_armed=True, now=0.0)
    assert not after.over(orphaned=True, any_armed=True, now=10.0)
    assert not after.over(orphaned=True, any_armed=False, now=20.0)
    assert not after.over(orphaned=True, any_armed=True, now=21.0)
    assert not after.over(orphaned=True, any_armed=False, now=23.0)
    assert after.over(orphaned=True, any_armed=False, now=25.1)


def test_a_simulated_orphan_ends_after_its_limit_and_a_real_one_does_not():
    simulated, real = ShutdownPolicy(limit_s=60.0), ShutdownPolicy(limit_s=None)
    for after in (simulated, real):
        assert not after.over(orphaned=True, any_armed=True, now=0.0)
    assert simulated.over(orphaned=True, any_armed=True, now=60.0)
    assert not real.over(orphaned=True, any_armed=True, now=1e6)
