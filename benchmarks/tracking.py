"""Compare how well real PX4 and the built-in autopilot track setpoints.

    python benchmarks/tracking.py [--repeat N]

Flies examples 01 (position setpoints), 02 (velocity square) and 03 (attitude and thrust) through `arena up
--speed max`, once with each autopilot, with the same seed and world. Prints the tracking error of each,
measured with the world's true
state: the root mean square of the difference to the setpoint that the autopilot reports, and for steps also
    the
settling time and the final error. Each pair of results must agree within 25 %, or within the error of cameras
and estimators (`blur`). PX4 is found as the package finds it (PX4_HOME, PATH).
"""

from __future__ import annotations

import argparse
import csv
import math
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.geometry import matrix_from_quat

EXAMPLES = Path(__file__).parents[1] / "examples"
PROGRAMS = {
    "position": ("01_two_quads/position_setpoints.py", [0.0, 0.0, 0.0]),
    "velocity": ("02_velocity_square/velocity_square.py", [-0.75, -0.75, 0.0]),
    "attitude": ("03_attitude_thrust/lissajous.py", [0.0, 0.0, 0.0]),
}
PILOTS = ("px4", "builtin")
WITHIN = 0.25
NED, WXYZ = ("north", "east", "down"), ("w", "x", "y", "z")
SETTLED = 0.1  # of the way to a goal, and from then on
HEARTBEAT_S = 1.0
STEP_M = 0.3  # a setpoint that moves by more is a step

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One measured result.

    blur: difference that is not significant, whatever its percentage
    """

    name: str
    unit: str
    value: float
    blur: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Log:
    """Rows of a flight's log in OFFBOARD while airborne."""

    rows: list[dict[str, str]]

    def group(self, name: str, parts: tuple[str, ...] = NED) -> Array:
        """Return the columns of a group (n, len(parts)), NaN for empty cells."""
        return np.array([[float(row[f"{name}.{part}"] or "nan") for part in parts] for row in self.rows])

    @property
    def t(self) -> Array:
        return np.array([float(row["time.seconds"]) for row in self.rows])


def read_log(file: Path) -> Log:
    with file.open() as lines:
        rows = [
            row
            for row in csv.DictReader(lines)
            if row["info.flight_mode"] == "OFFBOARD" and row["info.is_landed"] != "True"
        ]
    # The mode comes with heartbeats, once a second: by the last rows the vehicle may be landing.
    last = float(rows[-1]["time.seconds"]) - HEARTBEAT_S
    return Log(rows=[row for row in rows if float(row["time.seconds"]) <= last])


# -- what is measured ---------------------------------------------------------------------------------------------------------


def position(log: Log) -> list[Figure]:
    """Measure the error against position setpoints: over the whole flight, and for each step."""
    t, p, goal = log.t, log.group("truth.pos"), log.group("pos_ref")
    off = np.linalg.norm(p - goal, axis=1)
    starts = [0, *(np.flatnonzero(np.linalg.norm(np.diff(goal, axis=0), axis=1) > STEP_M) + 1).tolist()]
    found = [Figure(name="position RMS", unit="m", value=_rms(off))]
    for k, (begin, end) in enumerate(zip(starts, [*starts[1:], len(t)], strict=True)):
        far = np.flatnonzero(off[begin:end] > SETTLED * off[begin])
        settled = t[begin + min(int(far[-1]) + 1, end - begin - 1)] - t[begin] if len(far) else 0.0
        found += [
            Figure(name=f"step {k + 1}: settled after", unit="s", value=float(settled), blur=0.1),
            Figure(name=f"step {k + 1}: error at its end", unit="m", value=float(off[end - 1]), blur=0.02),
        ]
    return found


def velocity(log: Log) -> list[Figure]:
    """Measure the error against velocity setpoints, in rows without a position setpoint."""
    v, goal = log.group("truth.vel"), log.group("vel_ref")
    by_velocity = np.isnan(log.group("pos_ref")).any(axis=1) & np.isfinite(goal).all(axis=1)
    off = (v - goal)[by_velocity]
    yaw = (
        log.group("truth.att_euler", ("yaw",))[by_velocity, 0]
        - log.group("pos_ref", ("yaw",))[by_velocity, 0]
    )
    return [
        Figure(name="velocity RMS, level", unit="m/s", value=_rms(np.linalg.norm(off[:, :2], axis=1))),
        Figure(name="velocity RMS, vertical", unit="m/s", value=_rms(off[:, 2]), blur=0.01),
        Figure(name="yaw RMS", unit="deg", value=math.degrees(_rms(np.angle(np.exp(1j * yaw))))),
    ]


def attitude(log: Log) -> list[Figure]:
    """Measure the error against attitude setpoints, in rows without a position or velocity setpoint."""
    alone = np.isnan(log.group("pos_ref")).any(axis=1) & np.isnan(log.group("vel_ref")).any(axis=1)
    is_at, goal = (matrix_from_quat(log.group(name, WXYZ)[alone]) for name in ("truth.att_q", "att_q_ref"))
    known = np.isfinite(goal).all(axis=(1, 2))
    up, wanted = is_at[known][:, :, 2], goal[known][:, :, 2]
    off = np.degrees(np.arccos(np.clip((up * wanted).sum(axis=1), -1.0, 1.0)))
    tilt = np.degrees(np.arccos(np.clip(up[:, 2], -1.0, 1.0)))
    height = log.group("truth.pos")[alone][known][:, 2]
    return [
        Figure(name="tilt RMS", unit="deg", value=_rms(off)),
        Figure(name="greatest tilt", unit="deg", value=float(tilt.max())),
        Figure(name="height, standard deviation", unit="m", value=float(height.std()), blur=0.01),
    ]


MEASURES = {"position": position, "velocity": velocity, "attitude": attitude}


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x[np.isfinite(x)] ** 2)))


def within(one: Figure, other: Figure) -> bool:
    return abs(one.value - other.value) <= max(WITHIN * min(one.value, other.value), one.blur)


# -- flights ------------------------------------------------------------------------------------------------------------------


def fly(kind: str, pilot: str, given: argparse.Namespace) -> Log:
    program, place = PROGRAMS[kind]
    with tempfile.TemporaryDirectory(prefix="b-") as name:
        folder = Path(name)
        (folder / "arena.yaml").write_text(
            f"address: {given.address}\nworld: {{seed: {given.seed}}}\nmocap: {{seed: {given.seed}}}\n"
            f"vehicles:\n  uav1: {{id: {given.id}, profile: {given.profile}, autopilot: {pilot}, "
            f"program: {EXAMPLES / program}, start: {{position: {place}}}}}\n"
        )
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
                f"{kind} with {pilot} failed ({done.returncode}):\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
            )
        (log,) = folder.glob("runs/*/csv/uav1.csv")
        if given.keep:
            (given.keep / f"{kind}_{pilot}_{given.seed}.csv").write_text(log.read_text())
        return read_log(log)


def compare(kind: str, given: argparse.Namespace) -> int:
    """Print the results of one program; return the number of results that do not agree."""
    both = [MEASURES[kind](fly(kind, pilot, given)) for pilot in PILOTS]
    bad = 0
    for px4, ours in zip(*both, strict=False):
        good = within(px4, ours)
        bad += not good
        ratio = ours.value / px4.value if px4.value else math.nan
        print(
            f"| {given.seed} | {kind} | {px4.name} [{px4.unit}] | {px4.value:.3f} | {ours.value:.3f} | {ratio:.2f} | "
            f"{'yes' if good else '**no**'} |",
            flush=True,
        )
    return bad


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--programs", nargs="+", choices=list(PROGRAMS), default=list(PROGRAMS))
    options.add_argument("--repeat", type=int, default=1, help="flights of each, each with a seed of its own")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--profile", default="iris")
    options.add_argument("--address", default="127.0.0.1")
    options.add_argument(
        "--id", type=int, default=1, help="of the vehicle: PX4s side by side need different ones"
    )
    options.add_argument("--keep", type=Path, help="folder for the logs")
    given: Any = options.parse_args()
    print(
        "| seed | program | what | PX4 v1.16 | built-in | ratio | within 25 % |\n|---|---|---|---|---|---|---|"
    )
    bad, first = 0, given.seed
    for seed in range(first, first + given.repeat):
        given.seed = seed
        bad += sum(compare(kind, given) for kind in given.programs)
    print(f"\n{bad} not within" if bad else "\nall within")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
