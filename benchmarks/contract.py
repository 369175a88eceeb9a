"""The contract script: one client run on the real PX4 and on the built-in autopilot, and the two transcripts compared.

python benchmarks/contract.py [--autopilot px4|builtin|both] [--case PATTERN ...] [--write]

Each case boots a vehicle in a world of its own, drives it over its MAVLink links and notes what comes back. PX4's transcript is
kept in px4_contract/px4-v1.16.json, so that the built-in autopilot can be held against it where no PX4 is installed
(`--autopilot builtin`). --write stores the observations of PX4 and puts the table into docs/builtin-autopilot.md. Exit code 1: a difference
that is not listed, with its reason, in px4_contract/known.py.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from contextlib import ExitStack
from fnmatch import fnmatchcase
from pathlib import Path

from px4_contract.cases import all_cases
from px4_contract.known import KNOWN
from px4_contract.registry import Case
from px4_contract.rig import Rig, Setup, Unfit, vehicle
from px4_contract.table import put_into, section, text
from px4_contract.transcript import Difference, Seen, Transcript, compare, dump, idle, load

from arena.schema.px4 import find_px4

HERE = Path(__file__).parent
RECORDED = HERE / "px4_contract" / "px4-v1.16.json"
PAGE = HERE.parent / "docs" / "builtin-autopilot.md"
Found = dict[str, dict[str, Seen]]


class Vehicles:
    """The vehicle that the next case gets: the last one again where both cases leave it on the ground and set it up alike."""

    def __init__(self, autopilot: str, given: argparse.Namespace) -> None:
        self._autopilot, self._given = autopilot, given
        self._stack, self._setup, self._rig = ExitStack(), Setup(), None

    def for_case(self, case: Case) -> Rig:
        if self._rig is None or not case.ground or case.setup != self._setup:
            self.close()
            g = self._given
            made = vehicle(self._autopilot, case.setup, address=g.address, number=g.id, speed=g.speed)
            self._rig, self._setup = self._stack.enter_context(made), case.setup
        return self._rig

    def after(self, case: Case, *, broken: bool) -> None:
        if broken or not case.ground:
            self.close()

    def close(self) -> None:
        self._stack.close()
        self._stack, self._rig = ExitStack(), None


def run(autopilot: str, cases: dict[str, Case], given: argparse.Namespace) -> Found:
    found: Found = {}
    vehicles = Vehicles(autopilot, given)
    try:
        for name, case in cases.items():
            begin, t, at = time.monotonic(), Transcript(), 0.0
            try:
                rig = vehicles.for_case(case)
                at = rig.now
                case.run(rig, t)
                at = rig.now - at
            except Unfit as error:
                t.note("broke off", str(error)[-300:])
            except (
                Exception
            ) as error:  # a case that breaks off is an observation too: what it had seen is kept
                if given.debug:
                    raise
                t.note("broke off", f"{type(error).__name__}: {error}")
            said = t.seen.get("broke off", f"{at:.0f} s simulated")
            print(
                f"{autopilot}: {name}: {len(t.seen)} observations, {said}, {time.monotonic() - begin:.0f} s",
                file=sys.stderr,
                flush=True,
            )
            found[name] = t.seen
            keep = given.keep_px4 if autopilot == "px4" else given.keep_builtin
            if keep:  # after every case: a run is long, and what it has seen should outlive what stops it
                keep.write_text(json.dumps(dump(found), indent=0))
            vehicles.after(case, broken="broke off" in t.seen)
    finally:
        vehicles.close()
    return found


def chosen(patterns: list[str]) -> dict[str, Case]:
    cases = {n: c for n, c in all_cases().items() if not patterns or any(fnmatchcase(n, p) for p in patterns)}
    if not cases:
        raise SystemExit("no such case; there are: " + "; ".join(all_cases()))
    return cases


def print_differences(differences: list[Difference], given: argparse.Namespace) -> None:
    for d in differences:
        if given.all or not d.reason:
            print(
                f"{d.key}\n    PX4       {text(d.px4)}\n    built-in  {text(d.builtin)}"
                + (f"\n    {d.reason}" if d.reason else "")
            )


def main() -> int:
    given = _arguments()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the world and PX4 are ended too
    cases = chosen(given.case)
    if given.list:
        print("\n".join(f"{c.name:40} {c.what}" for c in cases.values()))
        return 0
    recorded = load(json.loads(RECORDED.read_text())) if RECORDED.exists() else {}
    px4 = run("px4", cases, given) if given.autopilot != "builtin" else recorded
    builtin = run("builtin", cases, given) if given.autopilot != "px4" else {}
    if given.write and given.autopilot != "builtin":
        order = {n: (recorded | px4)[n] for n in all_cases() if n in recorded or n in px4}
        RECORDED.write_text(as_text(order))
    if not builtin:
        return 0
    return report({n: px4[n] for n in builtin if n in px4}, builtin, cases, given)


def as_text(found: Found) -> str:
    """One line an observation, so that a new recording shows in a diff what has changed."""
    cases = []
    for name, seen in dump(found).items():
        lines = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in seen.items())
        cases.append(f" {json.dumps(name)}: {{\n{lines}\n }}")
    return "{\n" + ",\n".join(cases) + "\n}\n"


def report(px4: Found, builtin: Found, cases: dict[str, Case], given: argparse.Namespace) -> int:
    differences = compare(px4, builtin, KNOWN)
    print_differences(differences, given)
    left = [d for d in differences if not d.reason]
    sizes = {n: sum(s.kind != "words" for s in px4[n].values()) for n in px4}
    print(
        f"{len(sizes)} cases, {sum(sizes.values())} observations, {len(differences)} differences, {len(left)} of them unexplained"
    )
    unseen = [n for n in builtin if n not in px4]
    if unseen:
        print("never recorded on PX4: " + "; ".join(unseen))
    if not given.case:
        for pattern in idle(KNOWN, differences):
            print(f"known.py: {pattern!r} explains nothing any more")
        if given.write:
            PAGE.write_text(
                put_into(PAGE.read_text(), section({n: c.what for n, c in cases.items()}, sizes, differences))
            )
    return 1 if left or unseen else 0


def _arguments() -> argparse.Namespace:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument(
        "--autopilot", choices=("px4", "builtin", "both"), help="default: both where PX4 is found"
    )
    options.add_argument(
        "--case", action="append", default=[], metavar="PATTERN", help="only these; may be given again"
    )
    options.add_argument(
        "--write", action="store_true", help="keep PX4's transcript, and the table when all cases were run"
    )
    options.add_argument("--all", action="store_true", help="print the known differences too")
    options.add_argument("--list", action="store_true", help="print the cases")
    options.add_argument("--speed", default="5", help="of the simulation; the script is in lockstep with it")
    options.add_argument("--address", default="127.77.0.1")
    options.add_argument(
        "--id", type=int, default=81, help="of the vehicle: its system id, ports and PX4 instance"
    )
    options.add_argument("--keep-px4", type=Path, metavar="FILE", help="write this run's transcript of PX4")
    options.add_argument("--keep-builtin", type=Path, metavar="FILE")
    options.add_argument(
        "--debug", action="store_true", help="a case that breaks off ends the run with its traceback"
    )
    given = options.parse_args()
    given.autopilot = given.autopilot or ("both" if find_px4(None) else "builtin")
    return given


if __name__ == "__main__":
    sys.exit(main())
