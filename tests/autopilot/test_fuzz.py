"""Fuzzed MAVLink never crashes the autopilot, makes it diverge, or moves a vehicle without a command.

A short campaign runs here, 100 000 messages in `make nightly`, any number by `python benchmarks/fuzz.py`. What the fuzzing found
is tested in test_mavlink_interface.py and test_autopilots.py.
"""

from __future__ import annotations

import campaign
import pytest
from campaign import check
from fuzzing import KINDS, Fuzz, read
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SHARE = {"powerless": 3000, "ground": 1500, "hover": 1200, "offboard": 120, "wild": 150}


@pytest.mark.parametrize("phase", SHARE)
def test_short_campaign(phase):
    tally = campaign.PHASES[phase](SHARE[phase], seed=2)
    assert tally.sent.total() >= SHARE[phase]
    assert tally.refused.total() > 0


@pytest.mark.nightly
@pytest.mark.parametrize("phase", campaign.PHASES)
def test_long_campaign(phase):
    campaign.PHASES[phase](round(100_000 * campaign.SHARES[phase]), seed=1)


@pytest.fixture(scope="module")
def noisy():
    flight = campaign.Noisy(seed=0, battery=0.0)
    flight.run(2.0)
    return flight


@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(st.randoms(use_true_random=False), st.integers(1, 8))
def test_unpowered_vehicle_stays_at_rest_under_any_message(noisy, rng, count):
    noisy.fuzz = Fuzz(rng)
    noisy.send_batch([x for _ in range(count) for x in noisy.fuzz.some()])
    noisy.run(0.02)
    check(noisy)
    assert not noisy.armed(0) and not noisy.motors.any()


@settings(max_examples=60)
@given(st.randoms(use_true_random=False), st.sampled_from(sorted(KINDS)))
def test_fuzzed_messages_of_every_kind_are_valid(rng, name):
    assert read(Fuzz(rng).frame(name)).get_type() == name
