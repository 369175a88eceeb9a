"""Accuracy and consistency of the built-in autopilot's estimator: hard flight with bad vision, and false poses.

    python benchmarks/estimator.py [--seeds N] [--seconds S]

First table: mean squares of the errors (NEES) and innovations (NIS) over the variance that the filter claims, 1 if it is right,
with the bounds of a sound filter (see tests/autopilot/stress.py), and the errors. Second table: results of false poses.
Exit code 1: a bound is broken or a false pose was followed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "autopilot"))

from stress import AS_ARENA, FAULTS, STRESSES, Fate, Stress, StressFlight, Verdict, judge, misled, together

HARD = StressFlight.hard
FOLLOWED_M = 0.25  # half of the smallest jump: a vehicle that moves further followed it


def in_hard_flight(seeds: int, seconds: float) -> bool:
    stresses = [*STRESSES, *AS_ARENA]
    logs, alpha = [], 1e-3 / (5 * len(stresses))
    for seed in range(1, seeds + 1):
        flight = StressFlight(stresses, seed=seed)
        flight.take_off()
        flight.run(3.0, HARD)
        logs.append(flight.log(seconds, HARD))
    tilted = np.mean([(np.degrees(log.tilt) > 20.0).mean() for log in logs])
    print(
        f"{seeds} flights of {seconds:g} s, {len(stresses)} vehicles each, tilted by over 20 deg {tilted:.0%} of the time\n"
    )
    heads = ("position", "velocity", "yaw", "NIS position", "NIS yaw")
    print("| vision | " + " | ".join(heads) + " | error: position, velocity, yaw |\n|" + "---|" * 7)
    sound = True
    for i, s in enumerate(stresses):
        found = judge(together([log.series(i) for log in logs]), alpha, s.matched)
        p, v, yaw = np.sqrt(np.mean([np.square(log.rms(i)) for log in logs], axis=0))
        cells = " | ".join(_cell(x) for x in found)
        print(f"| {s.name} | {cells} | {1e3 * p:.1f} mm, {1e3 * v:.1f} mm/s, {np.degrees(yaw):.3f} deg |")
        sound &= all(x.holds for x in found)
    return sound


def _cell(v: Verdict) -> str:
    return f"{v.mean:.2f} ({v.low:.2f} to {v.high:.2f}){'' if v.holds else ' **broken**'}"


def when_poses_lie() -> bool:
    heads = (
        "fault",
        "flown",
        "EKF2_NOAID_TOUT",
        "declared after",
        "drawn away",
        "estimate off",
        "landed off",
        "tilt",
    )
    print("\n| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    sound = True
    for noaid_s in (1.0, 5.0):
        for flown, each in (("hover", StressFlight.hover), ("hard", HARD)):
            flight = StressFlight(
                [Stress(name=name, matched=False, noaid_s=noaid_s) for name in FAULTS], hz=500
            )
            flight.take_off()
            flight.run(10.0, each)  # the accelerometer biases converge
            flight.faults = [make() for make in FAULTS.values()]
            for name, fate in zip(FAULTS, misled(flight, noaid_s + 13.0, each), strict=True):
                print(_row(name, flown, noaid_s, fate))
                off = fate.drawn_m if flown == "hover" else fate.astray_m
                sound &= off < FOLLOWED_M and fate.tilt_deg < 60.0 and fate.disarmed
    return sound


def _row(name: str, flown: str, noaid_s: float, f: Fate) -> str:
    drawn = f"{100 * f.drawn_m:.1f} cm" if flown == "hover" else "-"
    ground = f"{f.landed_off_m:.2f} m{'' if f.disarmed else ', armed'}"
    when, off, tilt = f"{f.declared_s:.2f} s", f"{100 * f.astray_m:.1f} cm", f"{f.tilt_deg:.0f} deg"
    return f"| {name} | {flown} | {noaid_s:g} s | {when} | {drawn} | {off} | {ground} | {tilt} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    kept = [in_hard_flight(given.seeds, given.seconds), when_poses_lie()]
    sys.exit(0 if all(kept) else 1)
