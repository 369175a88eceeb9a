"""Beside which arenas a replay sends nothing to a ground station on this computer."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from arena.cli import replay
from arena.plan import Plan, make_plan
from arena.schema import load_arena


def run_of(folder: Path, *, simulated: bool) -> Plan:
    (folder / "arena.yaml").write_text(
        "vehicles: {uav1: {autopilot: builtin, start: {position: [0, 0, 0]}}}\n"
    )
    made = make_plan(load_arena(folder / "arena.yaml"))
    return dataclasses.replace(
        made, vehicles=tuple(dataclasses.replace(v, simulated=simulated) for v in made.vehicles)
    )


def found(monkeypatch: pytest.MonkeyPatch, plan: Plan | None, **state: Any) -> bool:
    given = SimpleNamespace(**{"live": True, "survivors": dict, **state})
    monkeypatch.setattr(replay, "active_runs", lambda: [given])
    monkeypatch.setattr(replay, "plan_of", lambda _: plan)
    return replay._real_vehicles_run()


def test_real_vehicles_are_not_mixed_up_with_replayed_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, simulated = run_of(tmp_path, simulated=False), run_of(tmp_path, simulated=True)
    assert found(monkeypatch, real)
    assert not found(monkeypatch, simulated)
    assert found(monkeypatch, None), "a plan that cannot be read may have real vehicles"


def test_flight_whose_supervisor_has_died_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = run_of(tmp_path, simulated=False)
    assert found(monkeypatch, real, live=False, survivors=lambda: {"router": [1]})
    assert not found(monkeypatch, real, live=False)
