"""Fuzzed MAVLink against the built-in autopilot, at length: `python benchmarks/fuzz.py [--messages N] [--seed N] [--phase NAME]`.

Runs the phases of tests/autopilot/campaign.py in this process and prints for each message how many were sent, answered and
refused. Ends with an error at the first violation.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "autopilot")]

from campaign import PHASES, SHARES, Tally  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--phase", choices=list(PHASES), action="append", help="run only this phase; may be repeated"
    )
    given = parser.parse_args()
    total, began = Tally(), time.process_time()
    phases = given.phase or list(PHASES)
    whole = sum(SHARES[name] for name in phases)
    for name in phases:
        start = time.process_time()
        tally = PHASES[name](round(given.messages * SHARES[name] / whole), given.seed)
        total += tally
        print(
            f"{name:10} {tally.sent.total():7} messages, {time.process_time() - start:6.1f} s of CPU",
            flush=True,
        )
    print(f"\n{'message':40} {'sent':>7} {'answered':>8} {'refused':>8}")
    for name, sent in sorted(total.sent.items(), key=lambda x: -x[1]):
        print(f"{name:40} {sent:7} {total.answered[name]:8} {total.refused[name]:8}")
    count = f"{total.sent.total():7} {total.answered.total():8} {total.refused.total():8}"
    print(f"{f'all {len(total.sent)} kinds':40} {count}   {time.process_time() - began:.0f} s of CPU")


if __name__ == "__main__":
    main()
