"""The record of one flight, one JSON line of the campaign's file, and the table of all records. Pure."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass


@dataclass(kw_only=True)
class Strike:
    """A fault as it happened. at: time since the take-off [s].

    airborne: its vehicle was in the air; for a process of all vehicles, at least one was.
    worked: the fault was carried out, for example the process existed, or the disk was really full.
    """

    what: str
    target: str
    at: float
    airborne: bool = False
    worked: bool = True


@dataclass(frozen=True, kw_only=True)
class Record:
    """Result of one flight.

    script: its faults, as text.  late: vehicle that joined late, "" for none.  end: how it was ended.
    why: violated rules; empty if all were kept.
    took_off: vehicles that were armed.  airborne: vehicles that left the ground.
    takeovers: pilots who took over in the air.  landed: vehicles that `arena` reported as landed.
    forgotten: vehicles that the operator declared dead.
    restarts: restarts of processes by the supervisor.
    lasted_s, cpu_s: duration, and CPU time of all its processes [s].
    load: load of the machine in the last minute, at the end.
    """

    seed: int
    script: str
    late: str
    end: str
    why: Sequence[str]
    took_off: int
    airborne: int
    strikes: Sequence[Strike]
    takeovers: int
    landed: int
    forgotten: Sequence[str]
    restarts: int
    exit_code: int | None
    lasted_s: float
    cpu_s: float = 0.0
    load: float = 0.0

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> Record:
        """Return the record of one line. Raises ValueError or TypeError if the line is none."""
        raw = json.loads(line)
        return cls(**{**raw, "strikes": [Strike(**strike) for strike in raw["strikes"]]})

    def __str__(self) -> str:
        words = "; ".join(self.why) or "ok"
        return (
            f"seed {self.seed}: {words} ({self.airborne} in the air, {self.lasted_s:.0f} s, CPU {self.cpu_s:.0f} s) "
            f"| {self.script}"
        )


def table(records: Iterable[Record]) -> str:
    """Return a Markdown table of the faults, and what the flights were."""
    records = list(records)
    drawn: Counter[str] = Counter()
    worked: Counter[str] = Counter()
    airborne: Counter[str] = Counter()
    broken: Counter[str] = Counter()
    for record in records:
        for strike in record.strikes:
            drawn[strike.what] += 1
            worked[strike.what] += strike.worked
            airborne[strike.what] += strike.worked and strike.airborne
        kinds = [s.what for s in record.strikes] + [f"end: {record.end}"] + ["late join"] * bool(record.late)
        broken.update(set(kinds) if record.why else ())
    rows = [
        f"| {what} | {count} | {worked[what]} | {airborne[what]} | {broken[what]} |"
        for what, count in sorted(drawn.items())
    ]
    ends = Counter(f"end: {r.end}" for r in records)
    ends["late join"] = sum(bool(r.late) for r in records)
    rows += [f"| {what} | {count} | - | - | {broken[what]} |" for what, count in sorted(ends.items())]
    head = "| fault | drawn | carried out | of these in the air | flights with a violation |\n|---|---|---|---|---|"
    return "\n".join([head, *rows, "", _sums(records)])


def _sums(records: Sequence[Record]) -> str:
    wrong = [r for r in records if r.why]
    count = max(1, len(records))
    lines = [
        f"{len(records)} flights, {len(wrong)} with a violation",
        f"in the air: {sum(r.airborne for r in records)} vehicles, in {sum(r.airborne > 0 for r in records)} flights",
        f"reported as landed: {sum(r.landed for r in records)} vehicles",
        f"pilots who took over: {sum(r.takeovers for r in records)}",
        f"declared dead by the operator: {sum(len(r.forgotten) for r in records)} vehicles",
        f"restarts of processes: {sum(r.restarts for r in records)}",
        f"per flight: {sum(r.lasted_s for r in records) / count:.1f} s, CPU {sum(r.cpu_s for r in records) / count:.1f} s, "
        f"load {sum(r.load for r in records) / count:.1f}",
    ]
    return "\n".join(lines + [str(r) for r in wrong])
