"""Output of `arena params`: progress bars, reports of parameter pushes, tables of differences, counts of problems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from arena.params.checks.diff import Difference
    from arena.params.checks.findings import Finding
    from arena.params.transfer.session import PushReport
    from arena.schema import Vehicle


class ProgressBars:
    """Progress bars on stderr, one per vehicle. They appear only if stderr is a terminal."""

    def __init__(self, names: Mapping[str, Any] | Sequence[str]) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[phase]}"),
        )
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._tasks = {name: self._progress.add_task(name, total=None, phase="") for name in names}

    def __enter__(self) -> ProgressBars:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    @property
    def show(self) -> Callable[[Mapping[str, Any]], None]:
        """Function that updates the bars. Its argument is {vehicle name: progress}."""

        def update(progress: Mapping[str, Any]) -> None:
            for name, each in progress.items():
                self._progress.update(self._tasks[name], completed=each.n, total=each.of, phase=each.phase)

        return update


_ENDINGS = {
    "armed": "the vehicle is armed, so nothing more is written",
    "no connection": "no MAVLink from the vehicle for 10 s, or no answer to any request",
    "connection lost": "no MAVLink from the vehicle for 3 s",
    "interrupted": "interrupted",
    "wrong vehicle": "another vehicle answers",
}


def ending_text(ending: str, why: str) -> str:
    """Return the reason why a transfer of parameters or logs ended early, as text for the user.

    ending: how the transfer ended. why: why the connection could not be opened; "" if it was opened.
    """
    return why or _ENDINGS.get(ending, ending)


def push_report_lines(name: str, report: PushReport, px4_version: str = "") -> list[str]:
    """Return the lines that report a parameter push to one vehicle.

    The first line has counts. Then there is one line per parameter that changed or failed. A vehicle with another PX4 version has
    a line about its version before them, and no other line if nothing was sent.

    px4_version: PX4 version whose parameter table was used; "" if it is not compared with the firmware of the vehicle.
    """
    from arena.params.transfer.writer import same_table

    wrong_version = report.ending == "wrong version"
    changed = any(r.may_have_changed for r in report.results.values())
    lines = []
    if wrong_version:
        stopped = "the push has stopped" if changed else "nothing was written"
        lines.append(f"{name}: {stopped}: {_wrong_version_text(report.firmware, px4_version)}")
        if not changed:
            return lines
    counts = Counter(r.outcome for r in report.results.values())
    summary = ", ".join(f"{n} {outcome}" for outcome, n in counts.items() if n) or "nothing to write"
    ending = "" if report.ending == "done" or wrong_version else f"{ending_text(report.ending, report.why)}; "
    lines.append(f"{name}: {ending}{summary} ({report.traffic.seconds:.1f} s)")
    for parameter, r in report.results.items():
        if r.outcome in ("same", "unread"):
            continue
        old = "?" if r.old is None else f"{r.old:g}"
        detail = {
            "written": f"{old} -> {r.wanted:g}",
            "differs": f"the vehicle has {old}, wanted {r.wanted:g}",
            "refused": f"wanted {r.wanted:g}, the vehicle keeps {'?' if r.new is None else f'{r.new:g}'}",
            "unknown": "the vehicle has no such parameter",
            "unanswered": "no answer: the value may or may not be set",
        }[r.outcome]
        lines.append(f"  {parameter}: {r.outcome}: {detail}{f' ({r.why})' if r.why else ''}")
    if report.needs_reboot and report.ending != "done":
        lines.append(f"  {name} needs a reboot for {', '.join(report.needs_reboot)}")
    identified = report.ending not in ("no connection", "wrong vehicle", "wrong version")
    if identified and px4_version and not same_table(report.firmware, px4_version):
        has = (
            f"has firmware {report.firmware}"
            if report.firmware
            else "does not report the version of its firmware"
        )
        lines.append(
            f"  warning: the vehicle {has}; names and limits of the parameters are those of PX4 {px4_version}"
        )
    return lines


def _wrong_version_text(firmware: str, px4_version: str) -> str:
    """Return that a vehicle has another PX4 version, and what to do. firmware: version that the vehicle reports."""
    right = ".".join(firmware.split(".")[:2])
    return (
        f"the vehicle has firmware {firmware}, but the values were generated for PX4 {px4_version}. "
        f'The two versions have different parameters. Write `px4_version: "{right}"` for the vehicle in the YAML, '
        f"or use --px4-version {right}"
    )


def measured_lines(vehicle: Vehicle, unmeasured: Mapping[str, float]) -> list[str]:
    """Return the output of `arena params measured` for one vehicle, as lines of text.

    They list the measured parameters, and the parameters that nobody has set or measured.

    unmeasured: parameter that nobody has set or measured -> its value in the simulation.
    """
    lines = [f"{vehicle.name}: {len(vehicle.measured)} parameters measured"]
    lines += [f"  {name}: {one.value:g}, {one.date}, {one.how}" for name, one in vehicle.measured.items()]
    if unmeasured:
        lines.append("  the vehicle keeps its own value of these (value of the simulation in parentheses):")
        lines += [f"  {name} ({value:g})" for name, value in unmeasured.items()]
    return lines


def print_differences(rows: Sequence[Difference], a: str, b: str) -> None:
    """Print a table of the parameters that differ between two sets.

    a, b: names of the two parameter sets.
    """
    from rich.console import Console
    from rich.table import Table

    if not rows:
        print(f"{a} and {b}: no difference")
        return
    table = Table("name", a, b, "", box=None, pad_edge=False)
    for row in rows:
        table.add_row(row.name, *("-" if x is None else f"{x:.7g}" for x in (row.a, row.b)), row.note)
    Console().print(table)


def count_text(found: Sequence[Finding]) -> str:
    """Return the numbers of errors, warnings and notes as text, such as "1 error, 2 warnings"."""
    counts = {s: sum(f.severity == s for f in found) for s in ("error", "warning", "note")}
    return (
        ", ".join(f"{n} {severity}{'s' * (n != 1)}" for severity, n in counts.items() if n)
        or "no problems found"
    )
