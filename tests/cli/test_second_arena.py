"""A second arena on one computer: what `arena up` says when the first one is in its way."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import pytest

from arena.cli import up
from arena.errors import RunError
from arena.plan import Plan, make_plan
from arena.plan.replay import ReplayedVehicle, ReplaySettings, make_replay_plan
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
    monkeypatch.setattr(up, "active_runs", lambda: [run])
    monkeypatch.setattr(up, "plan_of", lambda _: first)
    up._refuse_second(second)


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
    monkeypatch.setattr(up, "active_runs", lambda: [run])
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
        monkeypatch.setattr(up, "plan_of", lambda _, shown=shown: shown)
        up._refuse_beside_replay(simulated)
        if local_station:
            with pytest.raises(RunError, match=r"End it with `arena down --run /runs/replay`"):
                up._refuse_beside_replay(real)
        else:
            up._refuse_beside_replay(real)
