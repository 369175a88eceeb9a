"""Reaction times and touchdowns of flown scenarios, as a table in Markdown.

    arena smoke examples/06_failsafes --set defaults.autopilot=builtin --results results/builtin
    arena smoke examples/06_failsafes --set defaults.autopilot=px4 --results results/px4
    python benchmarks/scenarios.py results/builtin/results.json results/px4/results.json

All times are simulated. They count from the action or trigger: until all vehicles have the expected mode, or else until the first
expectation is fulfilled, and until the last touchdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from arena.smoke.referee.verdict import Result
from arena.smoke.report import read_results


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", type=Path)
    flown = [result for file in parser.parse_args().results for result in read_results(file.read_text())]
    print("\n".join(table(flown)))
    return int(not all(result.verdict.passed for result in flown))


def table(flown: Sequence[Result]) -> Iterator[str]:
    yield "| scenario | autopilot | result | first expectation | after s | down after s | touchdown m/s | drift m |"
    yield "|---|---|---|---|---|---|---|---|"
    for result in sorted(
        flown, key=lambda r: (r.scenario.partition(" [")[0], r.facts.get("autopilot", ""), r.scenario)
    ):
        yield f"| {' | '.join(row(result))} |"


def row(result: Result) -> list[str]:
    verdict, downs = result.verdict, result.verdict.touchdowns
    action = next((i for i, step in enumerate(verdict.steps) if step.kind == "do"), -1)
    within = [s for s in verdict.steps[action + 1 :] if s.kind == "expect" and " within " in s.place.text]
    expected = next((s for s in within if ".mode ==" in s.place.text), within[0] if within else None)
    took, begun_s = (None, None) if expected is None else (expected.took_s, expected.begun_s)
    return [
        result.scenario,
        result.facts.get("autopilot", ""),
        "passed" if verdict.passed else "FAILED",
        "" if expected is None else expected.place.text.partition(" within ")[0],
        _number(took),
        _number(max((d.at_s - begun_s for d in downs), default=None) if begun_s is not None else None),
        _number(max((d.speed_m_s for d in downs), default=None)),
        _number(max((d.drift_m for d in downs if d.drift_m is not None), default=None)),
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


if __name__ == "__main__":
    raise SystemExit(main())
