"""The exchange of a signing key with a vehicle."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.key_exchange import KeyExchange
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_signing import SETUP_SIGNING, FrameSigner, has_signature, is_signed

NEW, OLD, THIRD = (bytes([n]) * 32 for n in (1, 2, 3))
WALL_S = 1_795_000_000.0


class Board:
    """An autopilot that takes a key as PX4 1.18 does: only signed if it has one, and only while it is disarmed."""

    def __init__(self, key=None, armed=False):
        self.codec, self.key, self.armed = Codec(7, 1), key, armed

    def heartbeat(self):
        mode = 129 if self.armed else 1
        plain = self.codec.pack(mavlink.MAVLink_heartbeat_message(2, 12, mode, 0, 4, 3))
        return FrameSigner(self.key, 0).sign(plain, WALL_S) if self.key else plain

    def receive(self, data):
        for frame in parse_frames(data).frames:
            allowed = self.key is None or has_signature(self.key, data, frame)
            if frame.msgid == SETUP_SIGNING and allowed and not self.armed:
                (m,) = self.codec.parse(data)
                assert (m.target_system, m.target_component) == (7, 1) and m.initial_timestamp > 0
                self.key = bytes(m.secret_key)


def exchange_with(board, old_key=None, seconds=5):
    exchange = KeyExchange(7, NEW, old_key)
    for now in range(seconds):
        for data in exchange.due(WALL_S + now, float(now)):
            board.receive(data)
        data = board.heartbeat()
        exchange.receive(data, parse_frames(data).frames)
    return exchange


def test_vehicle_without_a_key_gets_the_key() -> None:
    board = Board()
    exchange = exchange_with(board)
    assert exchange.done and exchange.changed and not exchange.problem
    assert board.key == NEW


def test_vehicle_with_the_old_key_gets_the_new_one_in_a_signed_message() -> None:
    board = Board(OLD)
    assert exchange_with(board, OLD).done
    assert board.key == NEW


def test_vehicle_that_has_the_key_is_not_changed() -> None:
    exchange = exchange_with(Board(NEW))
    assert exchange.done and not exchange.changed


@pytest.mark.parametrize("old_key", [None, THIRD])
def test_vehicle_with_another_key_is_a_problem(old_key) -> None:
    board = Board(OLD)
    exchange = exchange_with(board, old_key)
    assert "has another key" in exchange.problem and not exchange.done and board.key == OLD


def test_armed_vehicle_gets_no_key() -> None:
    board = Board(armed=True)
    exchange = exchange_with(board)
    assert "is armed" in exchange.problem and not exchange.changed and board.key is None


def test_key_is_sent_only_after_a_heartbeat_of_the_vehicle() -> None:
    exchange = KeyExchange(7, NEW)
    sent = b"".join(exchange.due(WALL_S, 0.0) + exchange.due(WALL_S, 1.0))
    assert {f.msgid for f in parse_frames(sent).frames} == {0}
    other = Codec(8, 1).onboard_heartbeat()
    exchange.receive(other, parse_frames(other).frames)
    sent = b"".join(exchange.due(WALL_S, 2.0))
    assert not exchange.seen and NEW not in sent


def test_vehicle_that_does_not_sign_is_never_done() -> None:
    board = Board()
    board.receive = lambda data: None
    exchange = exchange_with(board)
    assert exchange.seen and not exchange.done


def test_first_key_is_sent_without_a_signature() -> None:
    exchange, data = KeyExchange(7, NEW), Board().heartbeat()
    exchange.receive(data, parse_frames(data).frames)
    setup = exchange.due(WALL_S, 0.0)[-1]
    assert not is_signed(setup, parse_frames(setup).frames[0])
