"""Verdict on one flight of a campaign: a failure of the computer is no result of the flight."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from arena.campaign import fly as module
from arena.campaign.design import Flight
from arena.errors import RunError

PLAN = {"vehicles": [{"name": "uav1"}]}
DONE = {"failed": [], "processes": {"recorder": {"stats": {"record": "complete"}}, "world": {"stats": {}}}}


class FakeSession:
    """An arena that has ended. None as `code`: it made no run folder."""

    code: int | None = 0
    outcome_: dict[str, Any] | None = DONE
    logs = ("uav1",)

    def __init__(self, options: Any) -> None:
        self._options = options
        self.run: Path | None = None

    def run_to_end(self, limit_s: float) -> int:
        if self.code is None:
            raise RunError("the arena made no run folder within 120 s")
        self.run = self._options.runs / "run"
        (self.run / "csv").mkdir(parents=True)
        (self.run / "plan.json").write_text(json.dumps(PLAN))
        if self.outcome_ is not None:
            (self.run / "outcome.json").write_text(json.dumps(self.outcome_))
        for name in self.logs:
            (self.run / "csv" / f"{name}.csv").touch()
        if self.code == 124:
            raise RunError("the arena did not end within 780 s of wall time: it was stopped")
        return self.code

    def outcome(self) -> dict[str, Any]:
        return self.outcome_ or {}


def broken(record: str) -> dict[str, Any]:
    return {"failed": [], "processes": {"recorder": {"stats": {"record": record}}}}


LATE = {
    **DONE,
    "failed": ["uav1 crashed"],
    "processes": {"world": {"stats": {"autopilot": {"uav1": {"late": 2}}}}},
}


@pytest.mark.parametrize(
    ("more", "passed", "lost", "reason"),
    [
        ({}, True, False, ""),
        ({"outcome_": {**DONE, "failed": ["uav1 crashed"]}, "code": 1}, False, False, "uav1 crashed"),
        ({"outcome_": LATE, "code": 1}, False, True, "uav1: its PX4 was late 2 times"),
        ({"outcome_": None}, False, True, "outcome.json is missing"),
        (
            {"outcome_": broken("No space left on device")},
            False,
            True,
            "not complete: No space left on device",
        ),
        ({"logs": ()}, False, True, "csv/uav1.csv missing"),
        ({"code": -9, "outcome_": None}, False, True, "exit code -9: it was killed"),
        ({"code": 1, "outcome_": None}, False, True, "exit code 1: no reason was recorded"),
        (
            {"outcome_": {**DONE, "failed": ["uav1 crashed"]}, "code": 1, "logs": ()},
            False,
            False,
            "uav1 crashed",
        ),
        ({"code": None}, False, True, "made no run folder"),
        ({"code": 124}, False, False, "did not end within"),
    ],
)
def test_failure_of_the_computer_is_no_result(
    more: dict[str, Any],
    passed: bool,
    lost: bool,
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "Session", type("Session", (FakeSession,), more))
    monkeypatch.setattr(module, "measured", lambda run: {})
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {autopilot: builtin}}\n")
    flight = Flight(
        id="a",
        number=1,
        kind="arena",
        file=str(tmp_path / "arena.yaml"),
        seed=1,
        settings={},
        overrides=(),
        wall_limit_s=600.0,
    )
    record = module.fly(flight, tmp_path)
    assert (record.passed, record.lost) == (passed, lost)
    assert reason in "".join(record.reasons) and bool(reason) == bool(record.reasons)
    assert bool(record.run) == (more.get("code", 0) is not None)
