"""Compare the simulation with the real flights of the thesis.

    python benchmarks/thesis.py [--data FOLDER] [--repeat N]

Flies the thesis's setpoint experiment (examples/thesis/setpoints/steps.py) through `arena up --speed max`, with two
vehicles of profile intel_aero and the built-in autopilot. Their start positions and parameters are those of
the two real vehicles, taken from the flight logs (ULog, PX4 v1.9). Then prints the distances between tracks.
The pairs of flights that the data's own README compares are printed first, to check the method.

Track: estimated positions in OFFBOARD, from the first step on (t = 0), relative to the position at that time.
Two tracks are compared at the lag of at most 1 s that brings them nearest, by the root mean square per axis.
Step: a change of the setpoint; the response is measured along the straight line from the position at that
time to the setpoint.

Each step is added to the estimated position, so the errors of whole tracks add up. Therefore each step is
also compared alone, from its own start time and position, without a lag.

The data are not part of this project. Without them nothing is flown.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2

HERE = Path(__file__).parent
DATA = HERE.parents[1] / "shared" / "data" / "thesis"
PROGRAM = HERE.parent / "examples" / "thesis" / "setpoints" / "steps.py"
STANDS_S = 0.9  # armed, before the first step: as in the logs of both real flights
NED = ("north", "east", "down")
PAIRS = (  # and what the data's README says of each
    ("gazebo_uav1", "real_uav2", (0.075, 0.187, 0.100)),
    ("gazebo_uav2", "real_uav3", (0.126, 0.139, 0.057)),
    ("real_uav2", "real_uav3", (0.098, 0.262, 0.049)),
)
OURS = (("uav2", "real_uav2"), ("uav3", "real_uav3"))
SAME_NAME = (
    "MPC_XY_P",
    "MPC_Z_P",
    "MPC_XY_VEL_MAX",
    "MPC_Z_VEL_MAX_UP",
    "MPC_Z_VEL_MAX_DN",
    "MPC_TILTMAX_AIR",
    "MPC_TILTMAX_LND",
    "MPC_THR_HOVER",
    "MPC_THR_MIN",
    "MPC_THR_MAX",
    "MPC_TKO_SPEED",
    "MPC_TKO_RAMP_T",
    "MPC_LAND_SPEED",
    "MPC_VELD_LP",
    "MC_ROLL_P",
    "MC_PITCH_P",
    "MC_YAW_P",
    "MC_ROLLRATE_MAX",
    "MC_PITCHRATE_MAX",
    "MC_YAWRATE_MAX",
    *(f"MC_{axis}RATE_{gain}" for axis in ("ROLL", "PITCH", "YAW") for gain in "PID"),
    "MC_RR_INT_LIM",
    "MC_PR_INT_LIM",
    "MC_YR_INT_LIM",
    "IMU_GYRO_CUTOFF",
    "EKF2_EVP_NOISE",
    "EKF2_EVA_NOISE",
)

Array = NDArray[np.float64]


# -- the parameters of the real vehicles --------------------------------------------------------------------------------------


def ulog_params(data: bytes) -> dict[str, float]:
    """Return the parameters at the start of a ULog. For the format see docs.px4.io, "ULog file format"."""
    if data[:7] != b"ULog\x01\x12\x35":
        raise SystemExit("this is not a ULog file")
    found: dict[str, float] = {}
    for kind, body in _messages(data):
        if kind == b"P":
            length = body[0]
            form, name = body[1 : 1 + length].decode().split(" ")
            found.setdefault(name, struct.unpack("<f" if form == "float" else "<i", body[1 + length :])[0])
    return found


def _messages(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = 16
    while place + 3 <= len(data):
        size = struct.unpack_from("<H", data, place)[0]
        yield data[place + 2 : place + 3], data[place + 3 : place + 3 + size]
        place += 3 + size


def of_today(old: Mapping[str, float], hover: float) -> dict[str, float]:
    """Convert parameters of PX4 v1.9 to v1.16.

    hover: the real hover thrust of the vehicle [-]

    Velocity gains: v1.9's are normalised thrust per m/s, v1.16's are acceleration per m/s. The factor is g
    divided by the hover thrust, as when PX4 renamed the parameters in v1.11.

    Vertical: both versions use MPC_THR_HOVER as the hover thrust, so it is used in the factor. Horizontal: in
    v1.9 the acceleration per thrust depends on the real hover thrust, in v1.16 it does not, so the real hover
    thrust is used.
    """
    now = {name: old[name] for name in SAME_NAME}
    for axis, thrust in (("XY", hover), ("Z", old["MPC_THR_HOVER"])):
        now |= {
            f"MPC_{axis}_VEL_{gain}_ACC": old[f"MPC_{axis}_VEL_{gain}"] * GRAVITY_M_S2 / thrust
            for gain in "PID"
        }
    # v1.9 weighs yaw by the ratio of the attitude gains, and had no hover thrust estimator.
    now["MC_YAW_WEIGHT"] = old["MC_YAW_P"] / (0.5 * (old["MC_ROLL_P"] + old["MC_PITCH_P"]))
    now |= {
        "COM_SPOOLUP_TIME": old["MPC_SPOOLUP_TIME"],
        "IMU_DGYRO_CUTOFF": old["MC_DTERM_CUTOFF"],
        "MPC_USE_HTE": 0,
    }
    return {name: round(value, 6) for name, value in now.items()}


# -- tracks -------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Step:
    """Response to one step.

    rise_s: time from 10 to 90 % of the distance [s]
    overshoot: overshoot as a share of the distance [-]
    error_m: distance to the setpoint at the end of the step [m]
    """

    rise_s: float
    overshoot: float
    error_m: float


@dataclass(frozen=True, kw_only=True)
class Track:
    """Track of one flight in OFFBOARD.

    t: time since the first step [s] (n,)
    p: estimated position, relative to the position at the first step [m] [NED] (n, 3)
    goal: position setpoint, relative to the same position [m] [NED] (n, 3)
    start: rows at which a step begins
    """

    t: Array
    p: Array
    goal: Array
    start: tuple[int, ...]

    def leg(self, k: int) -> tuple[Array, Array]:
        """Return time [s] (m,) and position [m] (m, 3) during step k, both relative to its start."""
        begin, end = self.start[k], (*self.start, len(self.t))[k + 1]
        return self.t[begin:end] - self.t[begin], self.p[begin:end] - self.p[begin]

    def step(self, k: int) -> Step:
        t, p = self.leg(k)
        way = self.goal[self.start[k]] - self.p[self.start[k]]
        along = p @ way / float(way @ way)
        low, high = (
            t[np.argmax(along >= share)] if along.max() >= share else math.nan for share in (0.1, 0.9)
        )
        return Step(
            rise_s=float(high - low),
            overshoot=max(float(along.max()) - 1.0, 0.0),
            error_m=float(np.linalg.norm(p[-1] - way)),
        )


def read_track(file: Path) -> Track:
    """Read a flight log. The logs of the thesis and of this project have the same columns."""
    with file.open() as lines:
        rows = [
            row
            for row in csv.DictReader(lines)
            if row["info.flight_mode"] == "OFFBOARD" and row["pos_ref.north"] and row["ekf.pos.north"]
        ]
    t = np.array([float(row["time.seconds"]) for row in rows])
    p, goal = (
        np.array([[float(row[f"{group}.{axis}"]) for axis in NED] for row in rows])
        for group in ("ekf.pos", "pos_ref")
    )
    start = tuple((np.flatnonzero(np.linalg.norm(np.diff(goal, axis=0), axis=1) > 0.5) + 1).tolist())
    first = start[0]
    return Track(t=t - t[first], p=p - p[first], goal=goal - p[first], start=start)


def apart(one: Track, other: Track) -> tuple[Array, float]:
    """Return the root mean square per axis [m] (3,) at the lag of the best agreement, and that lag [s]."""
    lags = np.arange(-100, 101) / 100.0
    found = [_rms(one, other, lag) for lag in lags]
    best = int(np.argmin([float(x @ x) for x in found]))
    return found[best], float(lags[best])


def steps_apart(one: Track, other: Track) -> Array:
    """Return the root mean square per axis [m] (3,) over all steps, each relative to its own start."""
    squares = []
    for k in range(min(len(one.start), len(other.start))):
        (t, p), (u, q) = one.leg(k), other.leg(k)
        both = t <= u[-1]
        squares.append((p[both] - np.stack([np.interp(t[both], u, q[:, i]) for i in range(3)], axis=1)) ** 2)
    return np.asarray(np.sqrt(np.concatenate(squares).mean(axis=0)))


def _rms(one: Track, other: Track, lag: float) -> Array:
    at = one.t + lag
    both = (one.t >= 0.0) & (at >= other.t[0]) & (at <= other.t[-1])
    found = np.stack([np.interp(at[both], other.t, other.p[:, i]) for i in range(3)], axis=1)
    return np.asarray(np.sqrt(((one.p[both] - found) ** 2).mean(axis=0)))


# -- our flight ---------------------------------------------------------------------------------------------------------------


def arena_of(data: Path, given: argparse.Namespace) -> dict[str, Any]:
    """Return the configuration of an arena with the two real vehicles at their start positions."""
    from arena.schema import load_profile

    hover, vehicles = load_profile("intel_aero").hover_command, {}
    for name, real in OURS:
        with (data / f"setpoints_{real}.csv").open() as lines:
            row = next(csv.DictReader(lines))
        vehicles[name] = {
            "profile": "intel_aero",
            "autopilot": given.autopilot,
            "program": str(PROGRAM),
            "args": [str(STANDS_S)],
            "start": {
                "position": [round(float(row["ekf.pos.north"]), 3), round(float(row["ekf.pos.east"]), 3), 0],
                "rpy_deg": [0, 0, round(math.degrees(float(row["ekf.att_euler.yaw"])), 2)],
            },
        }
        if given.params == "log":
            log = (data / f"setpoints_{real}.ulg").read_bytes()
            vehicles[name]["params"] = of_today(ulog_params(log), hover)
    return {
        "address": given.address,
        "world": {"seed": given.seed},
        "mocap": {"latency_ms": 20, "seed": given.seed},
        "vehicles": vehicles,
    }


def fly(data: Path, given: argparse.Namespace, folder: Path) -> dict[str, Track]:
    (folder / "arena.yaml").write_text(yaml.safe_dump(arena_of(data, given)))
    command = [
        sys.executable,
        "-m",
        "arena.cli",
        "up",
        str(folder / "arena.yaml"),
        "--headless",
        "--until-done",
        "--speed",
        "max",
        "--time-limit",
        "300",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(
            f"the flight failed ({done.returncode}):\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
        )
    (run,) = (folder / "runs").glob("*")
    if given.keep:
        for name, _ in OURS:
            (given.keep / f"{name}.csv").write_text((run / "csv" / f"{name}.csv").read_text())
    return {name: read_track(run / "csv" / f"{name}.csv") for name, _ in OURS}


# -- tables -------------------------------------------------------------------------------------------------------------------


def table_of_pairs(tracks: Mapping[str, Track], ours: Mapping[str, Track]) -> tuple[str, bool]:
    """Return a Markdown table of all pairs, and whether our flights are near enough to the real ones.

    Near enough: no farther from the real flights than the thesis's Gazebo flights.
    """
    lines = [
        "| pair | lag s | RMS N / E / D m | by the README | each step alone m |",
        "|---|---|---|---|---|",
    ]
    bound, good = {}, True
    for one, other, known in PAIRS:
        rms, lag = apart(tracks[one], tracks[other])
        alone = steps_apart(tracks[one], tracks[other])
        lines.append(_row(f"{one}, {other}", rms, lag, _three(known), alone))
        bound[other] = rms if one.startswith("gazebo") else bound[other]
    for name, real in OURS:
        for other in (real, *(x for x in tracks if x != real)):
            rms, lag = apart(ours[name], tracks[other])
            near = bool((rms <= bound[real] + 5e-4).all())
            good &= near or other != real
            note = ("nearer" if near else "farther") if other == real else ""
            lines.append(
                _row(f"**ours** {name}, {other}", rms, lag, note, steps_apart(ours[name], tracks[other]))
            )
    return "\n".join(lines), good


def _row(name: str, rms: Array, lag: float, note: str, alone: Array) -> str:
    return f"| {name} | {lag:+.2f} | {_three(rms)} | {note} | {_three(alone)} |"


def _three(values: Iterable[float]) -> str:
    return " / ".join(f"{x:.3f}" for x in values)


def table_of_steps(tracks: Mapping[str, Track]) -> str:
    lines = ["| flight | rise s, steps 1 to 6 | overshoot % | final error m |", "|---|---|---|---|"]
    for name, track in tracks.items():
        steps = [track.step(k) for k in range(len(track.start))]
        cells = (
            " ".join(f"{s.rise_s:.2f}" for s in steps),
            " ".join(f"{100 * s.overshoot:.0f}" for s in steps),
            " ".join(f"{s.error_m:.3f}" for s in steps),
        )
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--data", type=Path, default=DATA)
    options.add_argument("--repeat", type=int, default=1, help="flights, each with a seed of its own")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--autopilot", choices=["builtin", "px4"], default="builtin")
    options.add_argument(
        "--params", choices=["log", "profile"], default="log", help="the vehicles' parameters come from here"
    )
    options.add_argument("--address", default="127.0.0.1")
    options.add_argument("--keep", type=Path, help="folder for the logs")
    given = options.parse_args()
    if not given.data.is_dir():
        print(f"no flight data in {given.data}: nothing to compare with")
        return 2
    logs = sorted({name for pair in PAIRS for name in pair[:2]})
    tracks = {name: read_track(given.data / f"setpoints_{name}.csv") for name in logs}
    failed = 0
    for seed in range(given.seed, given.seed + given.repeat):
        given.seed = seed
        with tempfile.TemporaryDirectory(prefix="b-") as folder:
            ours = fly(given.data, given, Path(folder))
        text, good = table_of_pairs(tracks, ours)
        failed += not good
        steps = table_of_steps({**tracks, **{f"**ours** {name}": track for name, track in ours.items()}})
        print(f"seed {seed}\n\n{text}\n\n{steps}\n", flush=True)
    print(json.dumps({"flights": given.repeat, "farther_than_gazebo": failed}))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
