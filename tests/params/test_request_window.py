"""What is asked for at once, and when a silence is believed."""

from __future__ import annotations

from arena.params.transfer.request_window import Asking, Pace


def test_the_more_a_wire_loses_the_more_silences_it_takes() -> None:
    clean, lossy = Pace(), Pace()
    for _ in range(60):
        clean.learn(1, 0.1)
        lossy.learn(2, 0.1)
    assert clean.enough == 5 and 15 <= lossy.enough <= 25


def test_patience_follows_the_round_trip() -> None:
    pace = Pace()
    for _ in range(50):
        pace.learn(1, 1.5)
    assert 1.5 < pace.patience(1) < 2.0 < pace.patience(3)


def test_no_more_than_the_window_are_in_flight() -> None:
    asking = Asking(range(1, 100), Pace(), 0)
    assert asking.due(0.0) == list(range(1, 11)) and asking.due(0.1) == []
    asking.answer(4, 0.2)
    assert asking.due(0.2) == [11]
