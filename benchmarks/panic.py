"""Time until `arena land-all` and `arena kill-all --yes` have commanded all vehicles, from the start of the process, with imports.

python benchmarks/panic.py [--repeat N] [--vehicles N N] [--burners N] [--address 127.66.250.1]

The vehicles are minimal fakes; the kernel stamps the time of each first command. `first` and `last`: from just before the process is
started until the first and the last vehicle has been sent its first command, median and worst. `cpu`: of the whole process. `cold`:
without Python's bytecode cache (`PYTHONPYCACHEPREFIX`, an empty folder). Burners are busy processes that run meanwhile.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE.parent / "tests" / "emergency")]

from emergency_fleet import Fleet  # noqa: E402  the vehicles of the tests

VERBS = (("land-all",), ("kill-all", "--yes"))


class CommandSockets:
    """The vehicles' ends of the panic links, read only after the process has ended: the kernel stamps each datagram."""

    def __init__(self, host: str, ids: range) -> None:
        self.sockets = []
        for k in ids:
            s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            s.setsockopt(socket.SOL_SOCKET, 35, 1)  # SO_TIMESTAMPNS
            s.bind((host, 24000 + 10 * k + 4))
            s.setblocking(False)
            self.sockets.append(s)

    def first_commands(self) -> list[float]:
        """Return the wall time of each vehicle's first COMMAND_LONG [s]."""
        return [self._first(s) for s in self.sockets]

    def _first(self, s: socket.socket) -> float:
        while True:
            data, more, _, _ = s.recvmsg(2048, 256)
            if data[7:10] == b"\x4c\0\0":
                seconds, nano = (int.from_bytes(more[0][2][at : at + 8], sys.byteorder) for at in (0, 8))
                return seconds + nano * 1e-9

    def close(self) -> None:
        for s in self.sockets:
            s.close()


def run_folder(folder: Path, host: str, count: int) -> Path:
    """Write a run folder with a plan only, which is all that land-all reads."""
    from arena.plan import make_plan
    from arena.schema import load_arena

    vehicles = {
        f"v{k}": {"autopilot": "builtin", "start": {"position": [k, 0, 0]}} for k in range(1, count + 1)
    }
    file = folder / "arena.yaml"
    file.write_text(
        json.dumps({"address": host, "world": {"size": [3 * count, 10, 3]}, "vehicles": vehicles})
    )
    (folder / "plan.json").write_text(make_plan(load_arena(file)).to_json())
    return folder


def once(verb: tuple[str, ...], run: Path, host: str, count: int, cold: bool) -> tuple[float, float, float]:
    """Return (first, last, cpu) of one command [s]."""
    with tempfile.TemporaryDirectory() as empty:
        env = {**os.environ, **({"PYTHONPYCACHEPREFIX": empty} if cold else {})}
        argv = [str(Path(sys.executable).with_name("arena")), *verb, "--run", str(run), "--timeout", "1.5"]
        sockets = CommandSockets(host, range(1, count + 1))
        began = time.time()
        process = subprocess.Popen(argv, stdout=subprocess.DEVNULL, env=env)
        _, _, used = os.wait4(process.pid, 0)
        process.returncode = 1
        at = [t - began for t in sockets.first_commands()]
        sockets.close()
    return min(at), max(at), used.ru_utime + used.ru_stime


def confirmed(verb: tuple[str, ...], run: Path, host: str, count: int) -> float:
    """Return the duration of the process with autopilots that obey and land in 0.2 s [s]."""
    argv = [str(Path(sys.executable).with_name("arena")), *verb, "--run", str(run)]
    with Fleet(range(1, count + 1), host):
        began = time.time()
        subprocess.run(argv, stdout=subprocess.DEVNULL, check=True)
        return time.time() - began


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[50, 200])
    parser.add_argument("--burners", type=int, default=0)
    parser.add_argument("--address", default="127.66.250.1")
    a = parser.parse_args()
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(a.burners)]
    print(f"{a.repeat} runs each, {a.burners} burners on {os.cpu_count()} cores; seconds\n")
    print(
        "| command | vehicles | caches | first | last | last, worst | cpu | all confirmed |\n|---|---|---|---|---|---|---|---|"
    )
    try:
        for count in a.vehicles:
            with tempfile.TemporaryDirectory() as folder:
                run = run_folder(Path(folder), a.address, count)
                for verb in VERBS:
                    for cold in (False, True):
                        got = list(
                            zip(
                                *(once(verb, run, a.address, count, cold) for _ in range(a.repeat)),
                                strict=True,
                            )
                        )
                        first, last, cpu = map(median, got)
                        end = "" if cold else f"{confirmed(verb, run, a.address, count):.2f}"
                        figures = " | ".join(f"{x:.2f}" for x in (first, last, max(got[1]), cpu))
                        print(
                            f"| {verb[0]} | {count} | {'cold' if cold else 'warm'} | {figures} | {end} |",
                            flush=True,
                        )
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


if __name__ == "__main__":
    main()
