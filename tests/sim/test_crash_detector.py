"""Crash detection and flight records, from made-up truth without physics."""

from __future__ import annotations

import numpy as np
import pytest

from arena.sim.crash_detector import CrashDetector
from arena.vehicle_models import VEHICLE_MODELS

DT = 0.004
LIMITS = VEHICLE_MODELS["multirotor"].crash_limits


def one_vehicle():
    """Return the crash detector of one vehicle, with the arrays of its true state as the attribute `truth`."""
    truth = {"p_n": np.zeros((1, 3)), "v_n": np.zeros((1, 3)), "r_nb": np.tile(np.eye(3), (1, 1, 1))}
    detector = CrashDetector(["uav1"], [LIMITS], **truth, step_s=DT)
    detector.truth = truth
    return detector


def watch(
    detector,
    seconds,
    *,
    v=(0.0, 0.0, 0.0),
    p=(0.0, 0.0, -1.0),
    floor=False,
    cos_tilt=1.0,
    others=None,
    start=0.0,
):
    detector.truth["p_n"][:], detector.truth["v_n"][:] = p, v
    detector.truth["r_nb"][:, 2, 2] = cos_tilt
    for k in range(round(seconds / DT)):
        detector.step(now=start + k * DT, floor=np.array([floor]), others=others or {})


def test_a_vehicle_on_the_floor_has_no_landing():
    detector = one_vehicle()
    watch(detector, 1.0, floor=True)
    assert detector.report()["uav1"] == {
        "crashed": "",
        "airborne": False,
        "airborne_s": 0.0,
        "landings": 0,
        "touchdown_m_s": None,
        "landed_p_n": None,
        "p_n": [0.0, 0.0, -1.0],
        "max_tilt_deg": 0.0,
        "max_height_m": 1.0,
    }


def test_touchdown_speed_is_that_before_the_contact():
    detector = one_vehicle()
    watch(detector, 2.0, v=(0, 0, 0.7))
    watch(detector, 1.0, floor=True, p=(1, 2, -0.05), start=2.0)
    report = detector.report()["uav1"]
    assert report["touchdown_m_s"] == 0.7
    assert report["landed_p_n"] == [1, 2, -0.05]
    assert report["airborne_s"] == pytest.approx(2.0)
    assert report["crashed"] == ""


def test_a_bounce_is_no_landing_but_a_hard_one_is_a_crash():
    detector = one_vehicle()
    watch(detector, 1.0, v=(0, 0, 0.5))
    watch(detector, 0.1, floor=True, start=1.0)
    watch(detector, 0.05, v=(0, 0, 0.2), start=1.1)
    watch(detector, 0.1, floor=True, start=1.15)
    report = detector.report()["uav1"]
    assert (report["landings"], report["touchdown_m_s"], report["crashed"]) == (1, 0.5, "")
    watch(detector, 0.05, v=(0, 0, 1.6), start=2.0)
    watch(detector, 0.1, floor=True, start=2.05)
    assert detector.report()["uav1"]["crashed"] == "touched down at 1.6 m/s at 2.05 s"


def test_the_first_crash_is_kept_and_reported_once():
    detector = one_vehicle()
    watch(detector, 0.1, others={0: "the north wall"})
    watch(detector, 0.1, cos_tilt=0.2, start=0.1)
    assert detector.report()["uav1"]["crashed"] == "touched the north wall at 0.00 s"
    assert detector.events() == ["uav1 crashed: touched the north wall at 0.00 s"]
    assert detector.events() == []
    assert detector.report()["uav1"]["max_tilt_deg"] == pytest.approx(78.46, abs=0.01)


@pytest.mark.parametrize(("tilt_deg", "crashed"), [(59.0, False), (61.0, True), (180.0, True)])
def test_tilt_above_sixty_degrees_is_a_crash(tilt_deg, crashed):
    detector = one_vehicle()
    watch(detector, 0.1, cos_tilt=np.cos(np.radians(tilt_deg)))
    assert bool(detector.report()["uav1"]["crashed"]) is crashed
