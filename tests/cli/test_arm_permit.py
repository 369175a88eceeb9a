"""`arena arm-permit`: the reason of a refusal stands in the output of the command."""

from __future__ import annotations

from typing import Any

import pytest

from arena.cli import arm_permit
from arena.errors import RunError

BY = "ada (arena arm-permit)"


class Clock:
    """A clock that only sleeping advances."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Arena:
    """A control socket whose links answer requests for a permit with `refusals`: vehicle -> reason, "" if granted."""

    def __init__(self, **refusals: str | None) -> None:
        self.refusals = refusals
        self.stats: dict[str, dict[str, Any]] = {v: {"arm_permit": ""} for v in refusals}

    def ask(self, **request: Any) -> dict[str, Any]:
        if request["do"] == "arm_permit":
            for vehicle in request["vehicles"]:
                if (refusal := self.refusals[vehicle]) is not None:
                    answer = {"number": 2, "by": request["by"], "refusal": refusal}
                    self.stats[vehicle] = {"arm_permit_answer": answer}
        return {"processes": {v: {"kind": "link", "vehicle": v, "stats": s} for v, s in self.stats.items()}}


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(arm_permit, "time", made)
    return made


def test_a_refused_permit_is_reported_at_once_with_its_reason(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    arena: Any = Arena(uav1="the axes check is running", uav2="")
    with pytest.raises(
        RunError, match=r"^uav1: got no arm permit: the axes check is running\. Run `arena arm"
    ) as e:
        arm_permit._request(arena, ["uav1", "uav2"], BY)
    assert "uav2" not in str(e.value)
    assert capsys.readouterr().out == "uav2: is allowed to arm now\n"
    assert clock.now < 1.0


def test_answer_to_an_earlier_request_is_not_used() -> None:
    arena: Any = Arena(uav1=None)
    arena.stats["uav1"] = {
        "arm_permit": BY,
        "arm_permit_answer": {"number": 1, "by": BY, "refusal": ""},
    }
    with pytest.raises(RunError, match="uav1: got no arm permit within 3 s"):
        arm_permit._request(arena, ["uav1"], BY)
