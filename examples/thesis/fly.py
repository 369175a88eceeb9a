"""Fly the experiments of the thesis and print its tables with a column of ours.

    python examples/thesis/fly.py [EXPERIMENT ...] [--backend NAME ...] [--autopilot NAME ...] [--runs FOLDER]

EXPERIMENT: folder beside this file, or FOLDER/FLIGHT for one of its flights; default: all.
A flight that its backend refuses is shown with the reason, and does not count as failed.
By default each flight is flown on every backend with the built-in autopilot, and on PX4 where PX4_HOME names a build of it.
All flights are faster than real time. The exit code is 1 if a figure is outside its limits or a flight failed.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from expectations import HERE, Expected, measure, read_expected, table

TIME_LIMIT_S = 1500.0
WALL_LIMIT_S = 1800.0
STOP_LIMIT_S = 120.0


@dataclass(frozen=True, kw_only=True)
class Variant:
    """How a flight is flown. autopilot: builtin or px4.  backend: library of the programs, mavlink or mavsdk."""

    autopilot: str
    backend: str

    def __str__(self) -> str:
        return f"{self.autopilot}, {self.backend}"

    @property
    def overrides(self) -> tuple[str, ...]:
        """Values of `--set`, as KEY=VALUE."""
        return f"defaults.autopilot={self.autopilot}", f"defaults.backend={self.backend}"


def chosen(names: Iterable[str]) -> Iterator[tuple[Path, str]]:
    """Yield the folder of each chosen experiment and the name of the chosen flight, "" for all flights."""
    folders = sorted(path.parent for path in HERE.glob("*/expect.yaml"))
    for name in names or [folder.name for folder in folders]:
        folder, _, flight = name.strip("/").partition("/")
        if HERE / folder not in folders:
            raise SystemExit(
                f"{name}: no such experiment, expected one of {', '.join(f.name for f in folders)}"
            )
        yield HERE / folder, flight


class RefusedError(Exception):
    """Flight that its backend refused, with the reason."""


def fly(flight: Expected, variant: Variant, runs: Path) -> Path | None:
    """Fly once and return the run folder, None if the flight failed. The output of `arena up` is printed only then.

    Raises RefusedError if the backend refused the flight.
    """
    overrides = [*flight.overrides, *variant.overrides]
    command = [sys.executable, "-m", "arena.cli", "up", str(flight.arena), "--headless", "--until-done"]
    command += ["--speed", "max", "--time-limit", str(TIME_LIMIT_S), "--no-report", "--runs", str(runs)]
    command += [word for override in overrides for word in ("--set", override)]
    code, output = run_within(command, WALL_LIMIT_S)
    if code != 0:
        if (reason := refusal(output, variant)) is not None:
            raise RefusedError(reason)
        print(output)
        return None
    (run,) = runs.iterdir()
    return run


def run_within(command: Sequence[str], limit_s: float) -> tuple[int, str]:
    """Run a command and return its exit code and its output.

    After limit_s [s] of wall time the command gets SIGTERM, on which `arena up` stops all its processes, and after STOP_LIMIT_S
    more SIGKILL. Such a command has failed.
    """
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as child:
        try:
            output, _ = child.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            child.terminate()
            try:
                output, _ = child.communicate(timeout=STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                child.kill()
                output, _ = child.communicate()
            return child.returncode or 1, f"{output}not finished after {limit_s:g} s of wall time\n"
        return child.returncode, output


def refusal(output: str, variant: Variant) -> str | None:
    """Return the reason for which a backend refused a flight, from the output of `arena up`; None without one."""
    found = re.search(rf"InputError: (backend {variant.backend}: .*?)\)?$", output, re.MULTILINE)
    return None if found is None else found[1]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiments", nargs="*", metavar="EXPERIMENT")
    parser.add_argument("--backend", nargs="+", default=["mavlink", "mavsdk"])
    parser.add_argument(
        "--autopilot", nargs="+", default=["builtin", *(["px4"] if "PX4_HOME" in os.environ else [])]
    )
    parser.add_argument("--runs", type=Path, help="folder for the run folders; default: a temporary folder")
    given = parser.parse_args(argv)
    variants = [Variant(autopilot=a, backend=b) for a in given.autopilot for b in given.backend]
    with tempfile.TemporaryDirectory() as temporary:
        wrong = [
            name
            for folder, only in chosen(given.experiments)
            for name in _experiment(folder, only, variants, given.runs or Path(temporary))
        ]
    print("all figures are inside their limits" if not wrong else "outside the limits: " + "; ".join(wrong))
    return 1 if wrong else 0


def _experiment(folder: Path, only: str, variants: list[Variant], runs: Path) -> Iterator[str]:
    """Fly an experiment, print its tables and yield the name of each flight with a figure outside its limits."""
    title, tests, flights = read_expected(folder)
    print(f"# {title} (tests {tests} of the thesis)\n", flush=True)
    for flight in flights:
        for variant in variants if only in ("", flight.name) else []:
            name = f"{folder.name}/{flight.name}, {variant}"
            try:
                run = fly(
                    flight,
                    variant,
                    runs / f"{folder.name}-{flight.name}-{variant.autopilot}-{variant.backend}",
                )
            except RefusedError as reason:
                print(f"{name}\nrefused: {reason}\n", flush=True)
                continue
            found = [] if run is None else measure(flight, run)
            print(f"{name}\n{table(found) if found else 'the flight failed'}\n", flush=True)
            if not found or not all(one.passed for one in found):
                yield name


if __name__ == "__main__":
    sys.exit(main())
