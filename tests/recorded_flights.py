"""Synthetic telemetry, logs and run folders, made without a flight."""

from __future__ import annotations

import functools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from record_files import UAV1

from arena.flight_log.csv_file import csv_lines
from arena.flight_log.vehicle_record import VehicleRecord
from arena.flight_log.vehicle_rows import make_flight_of
from arena.geometry import quat_from_euler
from arena.wire.flight_record import pack_true_state
from arena.wire.truth_page import Truth

STEPS = [(0.0, 0.0, -1.0), (1.0, 0.0, -1.0)]
OFFBOARD, LAND = 6 << 16, 4 << 16 | 6 << 24
LEVEL, ZERO = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


def truth_at(pos: np.ndarray, vel: np.ndarray, rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Truth:
    q_nb = quat_from_euler(np.array([rpy]))
    z = np.zeros((1, 3))
    return Truth(
        time_s=0.0, p_n=pos[None], q_nb=q_nb, v_n=vel[None], omega_b=z, accel_b=z, motors=np.zeros((1, 4))
    )


def stream(t: float, pos: np.ndarray, ref: tuple[float, ...], mode: int, armed: bool, landed: bool) -> bytes:
    """Return one datagram of an autopilot at t [s], with an estimate 10 mm north of pos [m] [NED] (3,)."""
    out, ms = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), round(t * 1e3)
    nan = float("nan")
    return b"".join(
        m.pack(out)
        for m in (
            mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * armed, mode, 4, 3),
            mavlink.MAVLink_extended_sys_state_message(0, 1 if landed else 2),
            mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 0, 87, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_local_position_ned_message(ms, pos[0] + 0.01, pos[1], pos[2], 0.0, 0.0, 0.0),
            mavlink.MAVLink_attitude_quaternion_message(ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_highres_imu_message(
                ms * 1000, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1013.0, 0, 12.0, 21.0, 0x1FFF
            ),
            mavlink.MAVLink_position_target_local_ned_message(
                ms, 1, 0, *ref, nan, nan, nan, 0, 0, 0, 0.0, nan
            ),
            mavlink.MAVLink_attitude_target_message(ms, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5),
        )
    )


@functools.cache
def flight_csv(*, real: bool = False, captured: bool = True) -> str:
    """Return a log of two steps of 3 s and a landing.

    Each step is reached with an error of 0.05 m to the east. The landing is 0.12 m north of the last step.

    real: without truth. captured: with motion capture; of a real vehicle its last second on the ground is
    missing.
    """
    record = VehicleRecord(replace(UAV1, simulated=not real))
    for i in range(300):
        t = (150 + i) / 30
        step = min(i // 90, 1)
        flown = i < 180
        pos = np.add(STEPS[step], (0.0, 0.05, 0.0)) if flown else np.array([1.12, 0.0, -0.05])
        mode, armed = (OFFBOARD, True) if flown else (LAND, i < 240)
        record.add_down(t, stream(t, pos, STEPS[step], mode, armed, not flown))
        if captured and not (real and i > 270):
            record.add_pose(t, t, (*LEVEL, *pos))
        if not real:
            record.add_truth(t, pack_true_state(pos, ZERO, LEVEL, ZERO))
    flight = make_flight_of(record, 30.0)
    assert flight is not None
    return "".join(csv_lines(flight))


def make_run(folder: Path, *, vehicles: int = 1) -> Path:
    """Write a complete run folder and return its path."""
    names = [f"uav{k + 1}" for k in range(vehicles)]
    (folder / "csv").mkdir(parents=True)
    text = flight_csv()
    for name in names:
        (folder / "csv" / f"{name}.csv").write_text(text)
    plan = {"vehicles": [{"name": n} for n in names], "slices": {"world": {"size_m": [7.0, 4.0, 3.0]}}}
    (folder / "plan.json").write_text(json.dumps(plan))
    process = {
        "state": "EXITED",
        "reason": "done",
        "exit_code": 0,
        "exit": "exit 0",
        "starts": 1,
        "cpu_s": 1.0,
    }
    process |= {"cpu_mean": 0.05, "rss_peak_mb": 40.0, "over_budget": []}
    world = {"lateness_p99_ms": 0.4, "lateness_worst_ms": 3.0, "rtf": 1.0, "rtf_min": 0.998, "rtf_max": 1.001}
    world["rtf_min_sim_s"] = 7.25
    world["vehicles"] = {n: {"crashed": ""} for n in names}
    processes = {"world": {**process, "stats": world}}
    recorded = {
        n: {"datagrams_hz": 120.0, "airborne_unix_s": 1_800_000_006.0 + i} for i, n in enumerate(names)
    }
    processes["recorder"] = {**process, "stats": {"vehicles": recorded}}
    outcome = {"name": "test", "start": "2027-01-15T08:00:00+00:00", "duration_s": 20.0}
    outcome |= {"cause": "done", "reason": "all programs ended"}
    outcome |= {"exit_code": 0, "failed": [], "landing": "", "processes": processes}
    (folder / "outcome.json").write_text(json.dumps(outcome))
    (folder / "events.jsonl").write_text("")
    return folder
