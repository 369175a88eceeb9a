"""Fixtures of the smoke tests: a referee of a scenario, and the plan of a small arena."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from arena.plan import Plan, make_plan
from arena.schema import load_arena
from arena.smoke.flying.session import free_address
from arena.smoke.language.scenario import load_scenarios
from arena.smoke.referee.referee import Referee

HEAD = """\
arena:
  world: {size: [10, 10, 4]}
  vehicles:
    uav1: {program: fly.py}
    uav2: {start: {position: [2, 0, 0]}}
"""


@pytest.fixture
def referee_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Referee]:
    """Return the referee of a scenario with these steps, rules and allowances."""
    monkeypatch.chdir(tmp_path)
    Path("fly.py").touch()

    def referee(
        steps: str, always: Iterable[str] = (), may: Iterable[str] = (), time_limit_s: float = 15.0
    ) -> Referee:
        rules = "\n" + "".join(f"  - {rule}\n" for rule in always) if always else " []\n"
        options = f"time_limit_s: {time_limit_s}\nmay: [{', '.join(may)}]\nalways:{rules}"
        Path("s.yaml").write_text(f"{HEAD}{options}steps:\n{steps}")
        return Referee(load_scenarios("s.yaml")[0])

    return referee


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """The plan of an arena of two vehicles."""
    (tmp_path / "arena.yaml").write_text(
        f"address: {free_address()}\ndefaults: {{autopilot: builtin}}\n"
        "vehicles:\n  uav1: {mocap_body: red}\n  uav2: {start: {position: [2, 0, 0]}, mocap_body: blue}\n"
    )
    return make_plan(load_arena(tmp_path / "arena.yaml"))
