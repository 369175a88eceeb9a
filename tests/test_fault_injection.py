"""The socket that receives faults, and the reading of their fields."""

from __future__ import annotations

import json
import socket
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena import fault_injection
from arena.errors import InputError, RunError
from arena.fault_injection import FaultReceiver, inject


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A short path: the path of a socket has a maximum length."""
    monkeypatch.chdir(tmp_path)
    return Path("world.faults")


@pytest.fixture
def listening(place):
    found = FaultReceiver(place)
    yield found
    found.close()


def raw(place, data: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(data, str(place))


def test_faults_are_taken_once_and_in_order(listening, place):
    assert listening.take() == []
    for k in range(3):
        inject(place, {"do": "wind", "wind_m_s": [k, 0, 0]})
    assert [f["wind_m_s"][0] for f in listening.take()] == [0, 1, 2]
    assert listening.take() == []


def test_the_socket_is_its_owners_alone_and_gone_at_the_end(listening, place):
    assert stat.S_IMODE(place.stat().st_mode) == 0o600
    listening.close()
    assert not place.exists()
    assert listening.take() == [] and listening.fileno() == -1
    listening.close()


def test_a_restarted_process_takes_the_socket_of_a_killed_one(place):
    killed = FaultReceiver(place)
    again = FaultReceiver(place)
    inject(place, {"do": "wind"})
    assert killed.take() == [] and again.take() == [{"do": "wind"}]
    again.close()


def test_without_a_path_there_is_no_socket():
    none = FaultReceiver(None)
    assert none.take() == [] and none.fileno() == -1
    none.close()


def test_a_path_too_long_is_an_error_in_one_sentence(tmp_path):
    with pytest.raises(RunError, match=r"cannot receive faults at .*too long"):
        FaultReceiver(tmp_path / ("x" * 120))


def test_sending_fails_without_a_receiver_and_when_none_is_read(listening, place, monkeypatch):
    monkeypatch.setattr(fault_injection, "_SEND_TIMEOUT_S", 0.05)
    with pytest.raises(RunError, match="no process receives faults at this socket"):
        inject("nowhere.faults", {"do": "wind"})
    with pytest.raises(RunError, match="no process receives faults at this socket"):
        for _ in range(10_000):
            inject(place, {"do": "wind"})
    while listening.take():
        pass
    inject(place, {"do": "wind"})


def test_an_invalid_fault_is_refused_with_an_event(listening, place):
    def apply(fault):
        return f"did {fault_injection.word(fault, 'do', ('this',))}"

    for data in (b"", b"\xff\xfe", b"[1]", b"[" * 4000, b"{}", b'{"do": "this"', b"x" * 9000):
        raw(place, data)
        assert listening.apply(apply) == ["fault refused: not a JSON object, or an empty one"], data[:20]
    raw(place, json.dumps({"do": "that" * 100}).encode())
    (event,) = listening.apply(apply)
    assert (
        event.startswith('fault refused: {"do": "thatthat')
        and event.endswith("expected one of this")
        and len(event) < 250
    )
    inject(place, {"do": "this"})
    assert listening.apply(apply) == ["fault: did this"]


NOT_NUMBERS = [None, "1", True, [1], float("nan"), float("inf"), -0.1, 1.1, 10**400]


@pytest.mark.parametrize("wrong", NOT_NUMBERS, ids=str)
def test_a_number_is_finite_and_within_limits(wrong):
    assert fault_injection.number({"x": 1}, "x", 0.0, 1.0) == 1.0
    with pytest.raises(InputError, match=r"x: got .*, expected a number from 0 to 1"):
        fault_injection.number({"x": wrong}, "x", 0.0, 1.0)
    with pytest.raises(InputError, match="x: got"):
        fault_injection.vector({"x": [0, wrong, 0]}, "x", 1.0) if wrong != -0.1 else fault_injection.vector(
            {"x": [0, 0]}, "x", 1.0
        )
    with pytest.raises(InputError, match="x: got"):
        fault_injection.whole({"x": wrong}, "x", 0, 1)


@pytest.mark.parametrize(
    "wrong", [None, "a", ["a"], ["a", "a"], ["a", "c"], ["a", ["b"]], ["a", "b", "b"], {"a": "b"}], ids=str
)
def test_two_words_are_different_and_known(wrong):
    assert fault_injection.words({"x": ["b", "a"]}, "x", ("a", "b"), 2) == ("b", "a")
    with pytest.raises(InputError, match=r"x: got .*, expected a list of 2 different words out of: a, b"):
        fault_injection.words({"x": wrong}, "x", ("a", "b"), 2)


@pytest.mark.parametrize("wrong", [None, 0, 1, "true", []], ids=str)
def test_on_is_true_or_false(wrong):
    assert (
        fault_injection.flag({"on": True}, "on") is True
        and fault_injection.flag({"on": False}, "on") is False
    )
    with pytest.raises(InputError, match="on: got"):
        fault_injection.flag({"on": wrong}, "on")


SCALAR = st.none() | st.booleans() | st.integers() | st.floats() | st.text()


@given(SCALAR | st.lists(SCALAR | st.lists(SCALAR), max_size=4))
def test_any_value_is_read_or_refused(value):
    fault, ab = {"x": value}, ("a", "b")
    for read in (
        lambda: fault_injection.word(fault, "x", ab),
        lambda: fault_injection.words(fault, "x", ab, 2),
        lambda: fault_injection.flag(fault, "x"),
        lambda: fault_injection.number(fault, "x", -9, 9),
        lambda: fault_injection.whole(fault, "x", -9, 9),
        lambda: fault_injection.vector(fault, "x", 9),
    ):
        try:
            read()
        except InputError as error:
            assert str(error).startswith("x: got ")
