"""Lateness of frames by two clocks with different zeros."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.mocap.client import CapturedFrame, Echo, Lateness, StreamLateness

RATE = 180


def test_late_first_frame_is_not_the_reference():
    lateness = Lateness(0.1)
    assert lateness.measure(0.0, 0.08, True) == 0.0
    lateness.measure(1.0, 1.0, True)
    assert lateness.measure(2.0, 2.08, True) == pytest.approx(0.08, abs=0.001)


def test_clock_drift_over_an_hour_makes_no_frame_stale():
    lateness = Lateness(0.1)
    for drift in (1e-4, -1e-4):
        lateness.reset()
        assert max(lateness.measure(t * (1 + drift), t, True) for t in (k / 20 for k in range(72_000))) < 0.01


@given(st.lists(st.tuples(st.floats(), st.floats(0, 0.1)), max_size=40))
def test_prompt_frames_are_accepted_within_a_second_of_any_stamps(history):
    lateness, now = Lateness(0.1), 0.0
    for stamp, dt in history:
        now += dt
        lateness.measure(stamp, now, False)
    late = [lateness.measure(t, t, False) for t in (now + k / RATE for k in range(4 * RATE))]
    assert late[-1] <= 0.1


# -- review fault 14: a queue that grows is seen ---------------------------------------------------------------------------


def passed(
    lateness: Lateness,
    times: tuple[float, float],
    delay: Callable[[float], float],
    *,
    flying: bool = False,
    echo: Callable[[float], Echo] | None = None,
) -> float:
    """Return the share of frames that are not late. echo: answer to the last echo request, as a function of time."""
    count = prompt = 0
    t, (_, end) = times[0], times
    last: Echo | None = None
    while t < end:
        if echo is not None and count % 90 == 0:
            last = echo(t)
        stamp = t - delay(t)
        late = lateness.measure_frame(CapturedFrame(count, stamp, (), (), stamp, last), t, flying)
        count, prompt, t = count + 1, prompt + (late <= 0.1), t + 1 / RATE
    return prompt / count


@pytest.mark.parametrize("flying", [False, True])
def test_frames_that_stay_late_are_never_accepted_as_prompt(flying):  # review fault 14
    lateness = Lateness(0.1)
    assert passed(lateness, (0.0, 10.0), lambda t: 0.01, flying=flying) == 1.0
    assert passed(lateness, (10.0, 130.0), lambda t: 0.51, flying=flying) == 0.0
    assert lateness.shifts == 0
    assert passed(lateness, (130.0, 131.0), lambda t: 0.01, flying=flying) == 1.0


def test_a_queue_that_grows_slowly_makes_frames_late():  # review fault 14
    lateness = Lateness(0.1)
    assert passed(lateness, (0.0, 5.0), lambda t: 0.01, flying=True) == 1.0
    passed(lateness, (5.0, 305.0), lambda t: 0.01 + 9e-4 * (t - 5.0), flying=True)
    assert lateness.measure(305.0 - 0.28, 305.0, True) == pytest.approx(0.27 - 2e-4 * 300.0, abs=0.01)


def test_processing_on_the_server_counts_as_lateness_if_it_grows():
    lateness = Lateness(0.1)
    for k in range(RATE):
        assert lateness.measure(k / RATE, k / RATE + 0.02, True, sent_s=k / RATE + 0.015) < 0.001
    assert lateness.measure(1.0, 1.42, True, sent_s=1.415) == pytest.approx(0.4, abs=0.001)


def test_a_server_clock_that_is_set_back_is_proven_by_echo_answers():
    lateness = Lateness(0.1)

    def answers(step_s: float) -> Callable[[float], Echo]:
        return lambda t: Echo(t - 0.002, t, t - 0.001 - step_s)

    assert passed(lateness, (0.0, 10.0), lambda t: 0.01, flying=True, echo=answers(0.0)) == 1.0
    assert passed(lateness, (10.0, 10.4), lambda t: 0.51, flying=True, echo=answers(0.5)) == 0.0
    assert passed(lateness, (12.0, 20.0), lambda t: 0.51, flying=True, echo=answers(0.5)) == 1.0
    assert lateness.shifts == 1
    assert lateness.latency_s == pytest.approx(0.01, abs=0.002)


def test_echo_answers_show_a_queue_that_existed_from_the_start():
    lateness = Lateness(0.1)
    prompt = passed(lateness, (0.0, 20.0), lambda t: 0.5, echo=lambda t: Echo(t - 0.004, t, t - 0.002))
    assert prompt < 0.01
    assert lateness.latency_s == pytest.approx(0.5, abs=0.01)
    assert lateness.clock_error_s < 0.01


@given(st.floats(-1e6, 1e6), st.floats(1e-4, 0.2), st.floats(0.0, 1.0))
def test_the_clock_error_limits_the_error_of_the_latency(offset, round_trip, share):
    lateness, latency = Lateness(0.5), 0.03

    def answer(t: float) -> Echo:
        return Echo(t - round_trip, t, t - round_trip * (1.0 - share) - offset)

    passed(lateness, (0.0, 3.0), lambda t: latency + offset, echo=answer)
    assert abs(lateness.latency_s - latency) <= lateness.clock_error_s + 1e-4


def test_echo_answers_that_took_long_are_ignored():
    lateness = Lateness(0.1)
    passed(lateness, (0.0, 3.0), lambda t: 0.01, echo=lambda t: Echo(t - 3.0, t, t - 1.0))
    assert math.isnan(lateness.latency_s)


def test_a_restarted_server_starts_the_measurement_again():
    stream = StreamLateness(0.1)
    for n in range(1000, 1010):
        assert stream.measure(CapturedFrame(n, n / RATE, (), ()), n / RATE) < 0.01
    late = [stream.measure(CapturedFrame(n, n / RATE, (), ()), 10.0 + n / RATE) for n in range(20)]
    assert late[:8] == [math.inf] * 8
    assert late[-1] < 0.01


@pytest.mark.parametrize("share", [0.01, 0.03])
def test_the_clock_of_a_slow_simulated_server_is_followed(share):
    lateness, last, prompt = Lateness(0.1), None, 0
    for k in range(60 * RATE):
        t = k / RATE
        server_s = t * (1.0 - share)
        if k % 36 == 0:
            last = Echo(t - 0.002, t, server_s - 0.001)
        frame = CapturedFrame(k, server_s - 0.01, (), (), server_s, last)
        prompt += lateness.measure_frame(frame, t, True) <= 0.1
    assert prompt == 60 * RATE
