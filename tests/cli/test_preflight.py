"""`arena preflight`: what the person sees, and the end of the command."""

from __future__ import annotations

from typing import Any

import pytest

from arena.cli import preflight
from arena.errors import RunError


class Clock:
    """A clock that only sleeping advances."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Arena:
    """A control socket that reports one status after the other; the last one stays. asked: requests other than ps."""

    def __init__(self, *statuses: dict[str, Any]) -> None:
        self._statuses = list(statuses)
        self.asked: list[dict[str, Any]] = []

    def ask(self, **request: Any) -> dict[str, Any]:
        if request["do"] != "ps":
            self.asked.append(request)
            return {"ok": True}
        status = self._statuses.pop(0) if len(self._statuses) > 1 else self._statuses[0]
        if status.get("state") == "interrupted":
            raise KeyboardInterrupt
        link = {"kind": "link", "vehicle": "uav1", "stats": {"axes_check": status}}
        return {"processes": {"router": {"kind": "router", "vehicle": None, "stats": {}}, "link.uav1": link}}


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(preflight, "time", made)
    return made


def status(number: int, state: str, text: str = "", *lines: str) -> dict[str, Any]:
    return {"number": number, "state": state, "text": text, "lines": list(lines)}


IDLE = status(0, "idle")


@pytest.mark.parametrize("state", ["passed", "failed"])
def test_each_instruction_and_the_result_are_printed_once(
    state: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arena = Arena(
        IDLE, IDLE, status(7, "running", "Lift it"), status(7, "running", "Lift it"),
        status(7, "running", "Tilt it"), status(7, state, "", "axes: 1 deg off"),
    )  # fmt: skip
    assert preflight._check(arena, "uav1") is (state == "passed")
    assert capsys.readouterr().out.splitlines() == [
        "uav1: Lift it", "uav1: Tilt it", f"uav1: {state}", "uav1:   axes: 1 deg off"
    ]  # fmt: skip
    assert [r["do"] for r in arena.asked] == ["preflight"]


def test_a_check_that_does_not_start_is_reported() -> None:
    with pytest.raises(RunError, match="has not started the check within 5 s"):
        preflight._check(Arena(IDLE), "uav1")


def test_a_restarted_link_ends_the_command() -> None:
    with pytest.raises(RunError, match="the check was lost"):
        preflight._check(Arena(IDLE, status(7, "running", "Lift it"), IDLE), "uav1")


def test_a_link_that_reports_nothing_new_ends_the_command() -> None:
    with pytest.raises(RunError, match="nothing new for 90 s"):
        preflight._check(Arena(IDLE, status(7, "running", "Lift it")), "uav1")


def test_an_interrupt_stops_the_check() -> None:
    arena = Arena(IDLE, status(7, "running", "Lift it"), status(7, "interrupted"))
    with pytest.raises(KeyboardInterrupt):
        preflight._check(arena, "uav1")
    assert arena.asked[-1]["do"] == "preflight" and arena.asked[-1]["stop"] is True
