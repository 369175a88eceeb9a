"""A second arena on one computer: what `arena up` says when the first one is in its way."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from arena.cli import _placing, main, up
from arena.errors import RunError
from arena.plan import Plan, make_plan
from arena.plan.replay import ReplayedVehicle, ReplaySettings, make_replay_plan
from arena.run_dirs import starting_alone
from arena.schema import load_arena


def plan_on(folder: Path, address: str, first_id: int) -> Plan:
    """Return the plan of an arena with one vehicle that flies PX4; an empty file stands for its binary."""
    binary, scripts = folder / "px4/bin/px4", folder / "px4/etc/init.d-posix"
    for made in (binary.parent, scripts):
        made.mkdir(parents=True, exist_ok=True)
    binary.touch(mode=0o755)
    (scripts / "rcS").touch()
    file = folder / f"{address}.yaml"
    file.write_text(
        f"address: {address}\npx4: {{home: {folder / 'px4'}}}\nvehicles: {{a: {{autopilot: px4, id: {first_id}}}}}\n"
    )
    return make_plan(load_arena(file))


def refuse(monkeypatch: pytest.MonkeyPatch, second: Plan, first: Plan) -> None:
    run = SimpleNamespace(
        live=True,
        address=first.address,
        name="first",
        supervisor=SimpleNamespace(pid=123),
        run="/runs/first",
    )
    monkeypatch.setattr(_placing, "active_runs", lambda: [run])
    monkeypatch.setattr(_placing, "plan_of", lambda _: first)
    _placing.refuse_second(second)


def test_px4_arenas_on_two_addresses_need_different_vehicle_ids(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = r"the arena .first. is running on 127.74.6.1 .* ids in the new arena, because PX4 binds its ports \(24070, 24072, 24074, "
    with pytest.raises(RunError, match=said):
        refuse(monkeypatch, plan_on(tmp_path, "127.74.6.2", 7), plan_on(tmp_path, "127.74.6.1", 7))
    refuse(monkeypatch, plan_on(tmp_path, "127.74.6.2", 8), plan_on(tmp_path, "127.74.6.1", 7))


def test_second_arena_on_one_address_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        RunError, match=r"End it with `arena down --run /runs/first`, or set another `address`"
    ):
        refuse(monkeypatch, plan_on(tmp_path, "127.74.6.1", 8), plan_on(tmp_path, "127.74.6.1", 7))


def test_real_vehicles_do_not_fly_beside_a_replay_for_ground_stations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = plan_on(tmp_path, "127.74.6.1", 7)
    real = dataclasses.replace(
        simulated, vehicles=tuple(dataclasses.replace(v, simulated=False) for v in simulated.vehicles)
    )
    run = SimpleNamespace(live=True, run="/runs/replay")
    monkeypatch.setattr(_placing, "active_runs", lambda: [run])
    for local_station in (True, False):
        vehicles = [ReplayedVehicle(name="a", id=7, body="a", simulated=False)]
        settings = ReplaySettings(
            name="lab",
            sources=["/a"],
            vehicles=vehicles,
            size_m=(7.0, 4.0, 3.0),
            local_station=local_station,
        )
        shown = make_replay_plan(settings)
        monkeypatch.setattr(_placing, "plan_of", lambda _, shown=shown: shown)
        _placing._refuse_beside_replay(simulated)
        if local_station:
            with pytest.raises(RunError, match=r"End it with `arena down --run /runs/replay`"):
                _placing._refuse_beside_replay(real)
        else:
            _placing._refuse_beside_replay(real)


REAL = """
mocap: {source: natnet, server: 10.0.0.5}
vehicles:
  uav1: {id: 9, autopilot: hardware, profile: iris, url: "udpin:127.75.0.1:14540", program: fly.py}
"""


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let `arena up` of a real vehicle ask a person, without starting anything. Return what happens, in order."""
    (tmp_path / "fly.py").touch()
    (tmp_path / "arena.yaml").write_text(REAL)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    happened: list[str] = []

    def ask(plan: Plan, *, yes: bool) -> str:
        with starting_alone(happened.append, 0.0):
            happened.append("asked")
        return "yes"

    def create(plan: Plan, runs: Path) -> None:
        with starting_alone(happened.append, 0.0):
            happened.append("created")
        raise RunError("enough")

    monkeypatch.setattr(up, "ask_consent", ask)
    monkeypatch.setattr(up, "create", create)
    monkeypatch.setattr(up, "place", lambda arena, plan, overrides, say: plan)
    return happened


def test_other_arenas_wait_while_one_is_created_but_not_while_a_person_is_asked(
    tmp_path: Path, asked: list[str], runtime_dir: Path
) -> None:
    assert main(["up", str(tmp_path)]) == 1
    waited = "another arena has been starting for 0 s: not waiting for it any longer"
    assert asked == ["asked", waited, "created"]


def test_arena_that_started_while_a_person_was_asked_is_seen(
    tmp_path: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch, runtime_dir: Path
) -> None:
    def refuse_late(plan: Plan) -> None:
        raise RunError("a replay is running")

    monkeypatch.setattr(up, "refuse_beside", refuse_late)
    assert main(["up", str(tmp_path)]) == 1
    assert asked == ["asked"]
