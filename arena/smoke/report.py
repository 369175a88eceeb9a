"""Output of scenario results: a table for the terminal, JUnit XML, and results.json.

JUnit XML is written with the standard library: `junitparser` would save some 15 of 45 lines and add a dependency.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any
from xml.etree import ElementTree

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from arena.smoke.language.model import Place
from arena.smoke.language.scenario import stem
from arena.smoke.referee.verdict import Result, RuleResult, StepResult, Touchdown, Verdict

_SUITE = "arena smoke"
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


# -- for people ---------------------------------------------------------------------------------------------------------------


def table(results: Sequence[Result]) -> RenderableType:
    """Return the result table for the terminal: one row per scenario, with its failures as file:line."""
    heads = (
        "scenario",
        "verdict",
        "seed",
        "flown [s]",
        "wall [s]",
        "slowest or failed step",
        "touchdown [m/s]",
    )
    made = Table(*(escape(head) for head in heads), box=None, pad_edge=False)
    for result in results:
        verdict = Text("passed", "green") if result.verdict.passed else Text("FAILED", "bold red")
        made.add_row(
            escape(result.scenario),
            verdict,
            str(result.seed),
            f"{result.verdict.lasted_s:.1f}",
            f"{result.wall_s:.1f}",
            escape(_slowest(result.verdict)),
            _hardest(result.verdict),
        )
    wrong = [
        Text.from_markup(line) for result in results if not result.verdict.passed for line in _reasons(result)
    ]
    return Group(made, *wrong)


def _slowest(verdict: Verdict) -> str:
    """Return the first step that failed, or the slowest expectation if no step failed, as text."""
    if failed := next((s for s in verdict.steps if s.outcome == "failed"), None):
        return f"FAILED: {failed.place.text}"
    times = [(s.took_s, s.place.text) for s in verdict.steps if s.kind == "expect" and s.took_s is not None]
    took, text = max(times, default=(0.0, ""))
    return f"{took:.2f} s: {text}" if text else ""


def _hardest(verdict: Verdict) -> str:
    return max((f"{t.speed_m_s:.2f}" for t in verdict.touchdowns), default="")


def _reasons(result: Result) -> Iterator[str]:
    yield f"\n[bold red]{escape(result.scenario)}[/]" + (f"  {escape(result.run)}" if result.run else "")
    yield from (f"  {escape(line)}" for line in reasons(result))


def reasons(result: Result) -> list[str]:
    """Return one text `file:line: reason` per failure of a scenario."""
    found = [f"{_where(place)}{sentence}" for place, sentence in result.verdict.failures]
    return (
        found
        if found or result.verdict.passed
        else [f"{result.file}: not all steps were reached: {result.verdict.ended}"]
    )


def _where(place: Place | None) -> str:
    return "" if place is None else f"{place.file}:{place.line}: "


def details(result: Result) -> list[str]:
    """Return the detailed result of a scenario: one line per step, rule, touchdown and problem.

    The lines contain times and worst values.
    """
    lines = [
        f"seed {result.seed}, {result.verdict.lasted_s:.2f} s of simulation, over: {result.verdict.ended}"
    ]
    lines += [f"run folder {result.run}"] if result.run else []
    lines += [_step(step) for step in result.verdict.steps]
    lines += [_rule(rule) for rule in result.verdict.rules]
    lines += [_touchdown(touchdown) for touchdown in result.verdict.touchdowns]
    return lines + list(result.verdict.problems)


def _step(step: StepResult) -> str:
    if step.outcome != "passed":
        when = ""
    elif step.kind == "expect":
        when = f" after {step.took_s:.2f} s, at {step.done_s:.2f} s"
    else:
        when = f" at {step.done_s:.2f} s"
    return f"{step.outcome:11} {step.place.text}{when}"


def _rule(rule: RuleResult) -> str:
    when = "" if rule.at_s is None else f" at {rule.at_s:.2f} s"
    worst = "" if rule.worst is None else f" (worst: {rule.worst:.2f} {rule.unit}, {rule.who}{when})"
    return f"{rule.outcome:11} {rule.place.text}{worst}"


def _touchdown(t: Touchdown) -> str:
    after = "" if t.after_s is None else f", {t.after_s:.2f} s after the last action"
    drift = "" if t.drift_m is None else f", {t.drift_m:.2f} m aside"
    return f"{t.vehicle} came down at {t.at_s:.2f} s{after}, at {t.speed_m_s:.2f} m/s{drift}"


def summary(results: Sequence[Result]) -> str:
    """Return one line: number of scenarios, number of failed scenarios, and total simulation time."""
    failed = sum(not r.verdict.passed for r in results)
    flown = sum(r.verdict.lasted_s for r in results)
    text = f"{len(results)} scenario{'s' if len(results) != 1 else ''}, "
    return text + (f"{failed} failed" if failed else "all passed") + f"; {flown:.0f} s of simulation"


# -- for machines -------------------------------------------------------------------------------------------------------------


def junit_xml(results: Sequence[Result], unflown: Iterable[str] = ()) -> str:
    """Return JUnit XML for CI servers: one testcase per scenario.

    unflown: names of scenarios that were interrupted or not started; each is reported as an error.
    """
    missing = list(unflown)
    failed = sum(not r.verdict.passed for r in results)
    counts = {
        "tests": str(len(results) + len(missing)),
        "failures": str(failed),
        "errors": str(len(missing)),
        "skipped": "0",
        "time": f"{sum(r.wall_s for r in results):.3f}",
    }
    root = ElementTree.Element("testsuites", {"name": _SUITE, **counts})
    suite = ElementTree.SubElement(root, "testsuite", {"name": _SUITE, **counts})
    for result in results:
        _testcase(suite, result)
    for name in missing:
        case = ElementTree.SubElement(suite, "testcase", {"classname": "smoke", "name": _plain(name)})
        ElementTree.SubElement(case, "error", {"message": "interrupted before its end", "type": "smoke"})
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _testcase(suite: ElementTree.Element, result: Result) -> None:
    about = {
        "classname": f"smoke.{stem(result.file)}",
        "name": result.scenario,
        "time": f"{result.wall_s:.3f}",
        "file": result.file,
        "line": str(_line(result)),
    }
    case = ElementTree.SubElement(suite, "testcase", {key: _plain(value) for key, value in about.items()})
    if not result.verdict.passed:
        text = [_plain(line) for line in reasons(result)]
        failure = ElementTree.SubElement(case, "failure", {"message": text[0], "type": "smoke"})
        failure.text = "\n".join(text)
    ElementTree.SubElement(case, "system-out").text = _plain("\n".join(details(result)))


def _line(result: Result) -> int:
    """Return the line of the first failure in the scenario file, or 1 if it is unknown."""
    return next((place.line for place, _ in result.verdict.failures if place is not None), 1)


def _plain(text: str) -> str:
    """Replace each character that XML does not allow by "?"."""
    return _NO_XML.sub("?", text)


def results_json(results: Sequence[Result]) -> str:
    """Return the results as JSON. `read_results` converts it back.

    The extra key `passed` is for other programs.
    """
    return json.dumps([_as_json(result) for result in results], indent=1) + "\n"


def result_json(result: Result) -> str:
    """Return one result as JSON, for `scenario.json` in its run folder."""
    return json.dumps(_as_json(result), indent=1) + "\n"


def _as_json(result: Result) -> dict[str, Any]:
    return {"passed": result.verdict.passed, **dataclasses.asdict(result)}


def read_results(text: str) -> list[Result]:
    """Return the results from a JSON text that `results_json` has written."""
    return [
        _result({key: value for key, value in raw.items() if key != "passed"}) for raw in json.loads(text)
    ]


def _result(raw: dict[str, Any]) -> Result:
    verdict = raw["verdict"]
    made = Verdict(
        steps=tuple(StepResult(**{**s, "place": Place(**s["place"])}) for s in verdict["steps"]),
        rules=tuple(RuleResult(**{**r, "place": Place(**r["place"])}) for r in verdict["rules"]),
        touchdowns=tuple(Touchdown(**t) for t in verdict["touchdowns"]),
        lasted_s=verdict["lasted_s"],
        ended=verdict["ended"],
        problems=tuple(verdict["problems"]),
    )
    return Result(**{**raw, "verdict": made})
