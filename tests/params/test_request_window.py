"""Tests of the request window: requests in flight, time-outs, ignored requests."""

from __future__ import annotations

from arena.params.transfer.request_window import LinkEstimate, RequestWindow


def test_lossy_link_needs_more_tries_until_ignored() -> None:
    clean, lossy = LinkEstimate(), LinkEstimate()
    for _ in range(60):
        clean.add_answer(1, 0.1)
        lossy.add_answer(2, 0.1)
    assert clean.tries_until_ignored == 5 and 15 <= lossy.tries_until_ignored <= 25


def test_timeout_follows_the_round_trip_time() -> None:
    link = LinkEstimate()
    for _ in range(50):
        link.add_answer(1, 1.5)
    assert 1.5 < link.timeout_s(1) < 2.0 < link.timeout_s(3)


def test_window_limits_requests_in_flight() -> None:
    window = RequestWindow(range(1, 100), LinkEstimate(), 0)
    assert window.due(0.0) == list(range(1, 11)) and window.due(0.1) == []
    window.answer(4, 0.2)
    assert window.due(0.2) == [11]
