"""The preflight checks one by one: what passes, and the sentence when a check fails."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import InputError
from arena.fcu_link.preflight_checks import PreflightChecks, sentence
from arena.fcu_link.settings import Settings

from .link_rig import POSE, YAW, Rig, odometry, slice_of


def test_a_vehicle_without_faults_may_be_armed():
    rig = Rig()
    rig.fly(2.0)
    assert rig.reasons() == []


def test_a_vehicle_without_telemetry_may_not_be_armed():
    found = Rig().reasons()
    assert found[0] == "Preflight: no telemetry received yet"
    assert "Preflight: no pose received" in found
    assert "Preflight: no position estimate" in found
    assert "Preflight: battery level unknown" in found


@pytest.mark.parametrize(
    ("state", "sentences"),
    [
        (
            {"p_n": (POSE[0] + 0.9, POSE[1] - 0.6, POSE[2] - 0.5)},
            ["Preflight: pose is 1.19 m from the estimate"],
        ),
        ({"p_n": (POSE[0], POSE[1], POSE[2] - 0.25)}, ["Preflight: pose is 0.25 m from the estimate"]),
        ({"p_n": (POSE[0] + 0.11, POSE[1] - 0.11, POSE[2] - 0.11)}, []),
        ({"yaw": YAW - math.radians(50)}, ["Preflight: pose yaw is 50 deg off the estimate"]),
        ({"yaw": YAW + math.tau - math.radians(14)}, []),
        ({"yaw": math.radians(-175), "pose_yaw": math.radians(174)}, []),
        (
            {"yaw": math.radians(-170), "pose_yaw": math.radians(170)},
            ["Preflight: pose yaw is 20 deg off the estimate"],
        ),
        ({"battery": 12}, ["Preflight: battery at 12 %, needs 20 %"]),
        ({"battery": 20}, []),
        ({"battery": -1}, ["Preflight: battery level unknown"]),
        ({"p_n": (3.6, 0.3, -0.1), "pose_n": (3.6, 0.3, -0.1)}, ["Preflight: N 3.60 m is outside +-3.5 m"]),
        (
            {"p_n": (-3.4, -2.2, -0.1), "pose_n": (-3.4, -2.2, -0.1)},
            ["Preflight: E -2.20 m is outside +-2 m"],
        ),
        ({"p_n": (0, 0, -3.1), "pose_n": (0, 0, -3.1)}, ["Preflight: height 3.10 m is over 3 m"]),
        ({"p_n": (0, 0, 0.04), "pose_n": (0, 0, 0.04)}, ["Preflight: 0.14 m below the floor"]),
        ({"p_n": (0, 0, -0.06), "pose_n": (0, 0, -0.06)}, []),
        ({"p_n": (math.nan, 0, 0)}, ["Preflight: estimate is not finite"]),
        ({"yaw": math.inf}, ["Preflight: estimate is not finite"]),
        ({"pose_n": (math.nan, 0, 0)}, ["Preflight: pose is not finite"]),
    ],
)
def test_a_failed_check_is_reported_with_its_numbers(state, sentences):
    rig = Rig()
    rig.fly(2.0, **state)
    assert rig.reasons() == sentences


def test_a_low_pose_rate_is_a_reason():
    rig = Rig(preflight={"pose_rate_hz": 80.0})
    rig.fly(2.0)
    (reason,) = rig.reasons()
    assert reason in ("Preflight: 50 poses/s, needs 64", "Preflight: 51 poses/s, needs 64")


def test_an_old_pose_is_a_reason():
    rig = Rig()
    rig.fly(2.0)
    rig.fly(0.2, poses=False)
    assert rig.reasons() == ["Preflight: no pose for 0.20 s (limit 0.1 s)"]


def test_an_old_estimate_and_then_silence_are_reasons():
    rig = Rig()
    rig.fly(2.0)
    rig.fly(0.6, telemetry=False)
    assert rig.reasons() == ["Preflight: estimate is 0.6 s old (limit 0.5 s)"]
    rig.fly(1.0, telemetry=False)
    assert rig.reasons()[0] == "Preflight: no telemetry for 1.6 s"


def test_poses_that_are_not_sent_do_not_count():
    rig = Rig()
    rig.fly(2.0)
    for _ in range(60):
        rig.now += 0.02
        rig.core.from_link("vision", rig.forwarder.pack(odometry()), rig.now)
    assert any("no pose" in r for r in rig.reasons())


def test_the_emptiest_battery_counts_without_a_total():
    rig = Rig()
    rig.fly(2.0, battery=-1)
    for pack, charge in ((0, 60), (1, 15)):
        rig.receive(mavlink.MAVLink_battery_status_message(pack, 0, 0, 0, [65535] * 10, 0, 0, 0, charge))
    assert rig.reasons() == ["Preflight: battery at 15 %, needs 20 %"]


def test_an_unmeasured_battery_passes_only_with_limit_zero():
    rig = Rig(preflight={"battery": 0.0})
    rig.fly(2.0, battery=-1)
    assert rig.reasons() == []


def test_without_poses_the_estimate_must_be_inside_the_room():
    rig = Rig(
        preflight={
            "poses": False,
            "position_m": None,
            "yaw_deg": None,
            "tilt_deg": None,
            "pose_age_s": None,
            "pose_rate_hz": None,
        }
    )
    rig.fly(2.0, poses=False)
    assert rig.reasons() == []
    rig.fly(1.0, poses=False, p_n=(9.0, 0.0, -0.1))
    assert rig.reasons() == ["Preflight: N 9.00 m is outside +-3.5 m"]
    rig.fly(1.0, telemetry=False, poses=False)
    assert rig.reasons()[0].startswith("Preflight: estimate is 1.0 s old")


@pytest.mark.parametrize("value", [None, 0, -1.0, float("nan"), "0.2", True])
@pytest.mark.parametrize("gate", ["position_m", "yaw_deg", "tilt_deg", "pose_age_s", "pose_rate_hz"])
def test_no_check_is_switched_off_by_an_empty_limit(gate, value):
    with pytest.raises(InputError, match=gate):
        Settings.from_slice(slice_of(preflight={gate: value}))


def test_an_incomplete_slice_is_refused_with_the_missing_key():
    raw = slice_of()
    del raw["preflight"]
    with pytest.raises(InputError, match="preflight"):
        Settings.from_slice(raw)


def test_every_reason_fits_a_statustext():
    checks = PreflightChecks(Settings.from_slice(slice_of(preflight={"size_m": [1e-3] * 3})).preflight)
    rig = Rig(preflight={"size_m": [1e-3, 1e-3, 1e-3]})
    rig.fly(2.0, p_n=(-1e9, 1e9, -1e9), pose_n=(1e9, -1e9, -1e9), battery=0)
    found = [*checks.reasons(1e9), *rig.reasons()]
    assert len(found) > 6
    assert all(len(r.encode()) <= 50 for r in found)
    assert len(sentence("é" * 60).encode()) <= 50
