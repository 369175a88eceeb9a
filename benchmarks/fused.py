"""CPU time of a whole fused arena per simulated second, at the greatest speed, by the number of vehicles.

    python benchmarks/fused.py [--vehicles 1 10 50] [--seconds 40] [--repeat 1] [--group]
        [--gpd FOLDER --gpd-python PYTHON --gpd-bench FILE]

Each vehicle flies circles with trajectory setpoints at 50 Hz; from 48 vehicles on one choreographer flies all of them at 20 Hz, as in
examples/11_swarm. The window begins 12 s after the start of the simulation, when all vehicles fly, and lasts `--seconds` of simulated
time. CPU time counts all threads of all processes of the arena: `arena:world` (world, autopilots, motion capture, forwarders, router,
recorder), the programs, and `other` (supervisor and observer).

With `--gpd` each flight is followed by gym-pybullet-drones with as many vehicles, and the ratios of CPU time and of speed are printed.
gym-pybullet-drones uses one core, an arena all cores. Use ratios, because other work on the machine changes both.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from arena.clock import SimTime
from arena.errors import RunError

FROM_S = 12.0  # of simulated time: all vehicles are in the air
FLEET_FROM = 48  # vehicles
TIMEOUT_S = 500.0

PROGRAM = """
import sys
from math import cos, pi, sin
from arena import UAV
with UAV.from_args() as uav:
    uav.start_offboard_mission()
    x, y, z = uav.ekf.pos
    began = uav.clock.now()
    while uav.clock.now() < {until}:
        a = 2 * pi * (uav.clock.now() - began) / 10
        uav.set_pos_vel_yaw([x + 0.3 * sin(a), y + 0.3 - 0.3 * cos(a), z - 1.5],
                            [0.19 * cos(a), 0.19 * sin(a), 0.0], 0.0, 50)
"""

FLEET = """
from math import cos, pi, sin
from arena import UAV
with UAV.all_from_args() as fleet:
    fleet.start_offboard_mission()
    at = fleet.pos
    began = fleet.clock.now()
    while fleet.clock.now() < {until}:
        a = 2 * pi * (fleet.clock.now() - began) / 10
        speed = at * 0 + [0.19 * cos(a), 0.19 * sin(a), 0.0]
        fleet.set_pos_vel_yaw(at + [0.3 * sin(a), 0.3 - 0.3 * cos(a), -1.5], speed, 0.0, 20)
"""


def write_arena(
    count: int,
    until_s: float,
    folder: Path,
    *,
    program: bool = True,
    group: bool = False,
    fleet: bool | None = None,
) -> Path:
    """Write the YAML and the program of an arena, vehicles 1.4 m apart, and return the path of the YAML.

    group: the programs of all vehicles run in one process.
    fleet: one program flies all vehicles. Default: from `FLEET_FROM` vehicles on
    """
    fleet = count >= FLEET_FROM if fleet is None else fleet
    (folder / "circle.py").write_text((FLEET if fleet else PROGRAM).format(until=until_s))
    side = max(1, round(count**0.5))
    grouped = f"{{path: circle.py, group: show, run: {'once' if fleet else 'each'}}}"
    run = grouped if fleet or group else "circle.py"
    lines = [
        f"world: {{size: [{1.4 * side + 8:.1f}, {1.4 * side + 8:.1f}, 6]}}",
        f"defaults: {{profile: iris{f', program: {run}' if program else ''}}}",
        "vehicles:",
    ]
    for k in range(count):
        north, east = 1.4 * (k // side - side / 2), 1.4 * (k % side - side / 2)
        lines.append(f"  uav{k + 1}: {{start: {{position: [{north:.2f}, {east:.2f}, 0]}}}}")
    path = folder / "arena.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


def cpu_s(pid: int) -> float:
    """Return the CPU time of all threads of a process [s]; 0 if it has ended."""
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
        return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) * 1e-9
    except (OSError, IndexError):
        return 0.0


def processes(root: int) -> dict[int, str]:
    """Return pid -> command name of a process and all its descendants."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
            children.setdefault(parent, []).append(int(entry.name))
    found, waiting = {}, [root]
    while waiting:
        pid = waiting.pop()
        try:
            found[pid] = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        waiting += children.get(pid, [])
    return found


class Flight(NamedTuple):
    """Measured flight.

    parts: CPU time per simulated second of the parts of the arena: world, programs, other [s]
    speed: simulated time divided by wall time
    """

    parts: dict[str, float]
    speed: float


def fly(count: int, seconds: float, after: list[str], *, group: bool = False) -> Flight:
    """Fly one arena, and measure it.

    group: as in `write_arena`
    after: command that is run with the pid of the world at the beginning of the window, such as a profiler
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write_arena(count, FROM_S + seconds + 1.0, folder, group=group)
        command = [
            sys.executable,
            "-m",
            "arena",
            "up",
            str(path),
            "--headless",
            "--speed",
            "max",
            "--until-done",
        ]
        with (folder / "out").open("w") as out:
            arena = subprocess.Popen([*command], stdout=out, stderr=out)
        try:
            return _measure(arena, folder, seconds, after)
        except RunError as error:
            raise SystemExit(f"{error}\n{(folder / 'out').read_text()[-2000:]}") from error
        finally:
            arena.terminate()
            try:
                arena.wait(60.0)
            except subprocess.TimeoutExpired:
                arena.kill()


def _measure(arena: subprocess.Popen[bytes], folder: Path, seconds: float, after: list[str]) -> Flight:
    clock = _wait_for(arena, folder)
    names = processes(arena.pid)
    began, began_s, before = time.monotonic(), clock.now(), {pid: cpu_s(pid) for pid in names}
    world = next(pid for pid, name in names.items() if "world" in name)
    profiler = subprocess.Popen([x.format(pid=world) for x in after]) if after else None
    while clock.now() < FROM_S + seconds and arena.poll() is None:
        time.sleep(0.02)
    spent, took = {pid: cpu_s(pid) - before[pid] for pid in names}, clock.now() - began_s
    speed = took / (time.monotonic() - began)
    if profiler is not None:
        profiler.wait()
    parts = {"world": 0.0, "programs": 0.0, "other": 0.0}
    for pid, name in names.items():
        is_program = "circle.py" in name or "group" in name
        parts["world" if pid == world else "programs" if is_program else "other"] += (
            max(0.0, spent[pid]) / took
        )
    return Flight(parts, speed)


def _wait_for(arena: subprocess.Popen[bytes], folder: Path) -> SimTime:
    """Wait until all vehicles fly. Return the simulation clock. Raises SystemExit if the arena ends."""
    clock, end = None, time.monotonic() + TIMEOUT_S
    while clock is None or clock.now() < FROM_S:
        if arena.poll() is not None or time.monotonic() > end:
            raise SystemExit((folder / "out").read_text())
        time.sleep(0.005)
        if clock is None:
            clock = _clock(folder)
    return clock


def _clock(folder: Path) -> SimTime | None:
    """Return the simulation clock of the run in a folder, None before it exists."""
    for found in folder.glob("runs/*/slices/world.json"):
        with contextlib.suppress(RunError, ValueError):
            return SimTime(json.loads(found.read_text())["clock"])
    return None


def rival(given: argparse.Namespace, count: int) -> tuple[float, float]:
    """Return gym-pybullet-drones' CPU time per simulated second [s], and its simulated time divided by wall time."""
    command = [given.gpd_python, given.gpd_bench, "--gpd", given.gpd, "-n", str(count), "--physics", "pyb"]
    command += ["--ctrl-freq", "240", "--seconds", "2", "--repeat", "1"]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    fields = out.splitlines()[-1].split()
    return 1.0 / float(fields[5]), float(fields[6])


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--vehicles", type=int, nargs="+", default=[1, 10, 50])
    options.add_argument("--seconds", type=float, default=40.0)
    options.add_argument("--repeat", type=int, default=1)
    options.add_argument(
        "--group", action="store_true", help="the programs of all vehicles run in one process"
    )
    options.add_argument("--gpd", help="folder that contains gym_pybullet_drones/")
    options.add_argument("--gpd-python", default=sys.executable)
    options.add_argument("--gpd-bench", help="path of gpd_bench.py")
    options.add_argument(
        "--profile", metavar="FILE", help="write a profile of the world's process with py-spy"
    )
    given = options.parse_args()
    for count in given.vehicles:
        ratios, ratios_of_speed = [], []
        for _ in range(given.repeat):
            spy = [
                "py-spy",
                "record",
                "-n",
                "-r",
                "400",
                "-d",
                "10",
                "-f",
                "raw",
                "-p",
                "{pid}",
                "-o",
                str(given.profile),
            ]
            parts, speed = fly(count, given.seconds, spy if given.profile else [], group=given.group)
            whole = sum(parts.values())
            line = f"{count:3} vehicles: {whole:.4f} CPU s per simulated second = {4000 * whole:6.0f} us per step ("
            line += ", ".join(f"{part} {4000 * each:.0f}" for part, each in parts.items()) + ")"
            line += f", {speed:.2f} x real time"
            if given.gpd:
                other, other_speed = rival(given, count)
                ratios.append(other / whole)
                ratios_of_speed.append(speed / other_speed)
                line += f"; gym-pybullet-drones {other:.4f}, {other_speed:.2f} x real time; "
                line += f"ratio of CPU times {other / whole:.2f}, of speeds {speed / other_speed:.2f}"
            print(line, flush=True)
        if len(ratios) > 1:
            line = f"{count:3} vehicles: median ratio of CPU times {statistics.median(ratios):.2f}"
            print(f"{line}, of speeds {statistics.median(ratios_of_speed):.2f}", flush=True)


if __name__ == "__main__":
    main()
