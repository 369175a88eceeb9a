"""The rules that judge a flight with random faults: each violation is found."""

from __future__ import annotations

import pytest

from benchmarks.chaos_flight.faults import draw
from benchmarks.chaos_flight.radio import Received
from benchmarks.chaos_flight.verdict import Observed, landed_names, violations

LAND = Received(at=12.0, sender=(253, 200), what="mode AUTO.LAND")
SETPOINT = Received(at=12.0, sender=(1, 191), what="setpoint")


@pytest.mark.parametrize(
    ("observed", "text"),
    [
        (Observed(name="uav1", armed_at_end=True), "uav1: left armed"),
        (Observed(name="uav1", armed_without_permit=True), "uav1: armed without a permit"),
        (
            Observed(name="uav1", false_landings=["uav1: landed"]),
            "uav1: reported as landed while armed: uav1: landed",
        ),
        (Observed(name="uav1", to_stranger=[LAND]), "uav1: mode AUTO.LAND from 253/200 to another uid"),
        (
            Observed(name="uav1", pilot_since=10.0, received=[LAND]),
            "uav1: mode AUTO.LAND from 253/200 2.0 s after the pilot took over",
        ),
    ],
)
def test_each_violation_is_found(observed, text):
    assert violations([observed]) == [text]


@pytest.mark.parametrize(
    "observed",
    [
        Observed(name="uav1", armed_at_end=True, declared=True),
        Observed(name="uav1", pilot_since=11.8, received=[LAND]),
        Observed(name="uav1", pilot_since=10.0, pilot_until=11.0, received=[LAND]),
        Observed(name="uav1", pilot_since=10.0, received=[SETPOINT]),
        Observed(name="uav1", received=[LAND]),
    ],
)
def test_what_is_allowed_is_no_violation(observed):
    assert violations([observed]) == []


def test_texts_of_land_all_name_the_landed_vehicles():
    text = (
        "uav1: landed and disarmed after 3.2 s\nuav2: NOT CONFIRMED: armed\nland: uav3: already on the ground"
    )
    assert landed_names(text) == {"uav1", "uav3"}


def test_a_seed_always_gives_the_same_faults():
    assert draw(7) == draw(7) and len({str(draw(seed)) for seed in range(100)}) == 100
