"""Run folders of an earlier version (tests/old_runs) are still read by land-all, params diff and logs."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from arena.cli import main
from arena.cli._params import targets_of
from arena.emergency import targets
from arena.emergency.run_record import DirectAddress, recorded_down
from arena.emergency.targets import Target
from arena.plan import Plan
from arena.schema import load_arena
from arena.schema.address_text import address_text
from arena.supervisor import active_runs, open_run
from arena.supervisor.run_folder import myself, plan_of
from arena.transport import ConnectionUrl

OLD = Path(__file__).parent / "old_runs"
HOST = "127.0.0.1"


@pytest.fixture
def active(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The old flight's folder as an active run: its supervisor is this process."""
    folder, runtime = tmp_path / "runs" / "two_quads", tmp_path / "runtime" / "two_quads"
    shutil.copytree(OLD / "two_quads", folder)
    runtime.mkdir(parents=True, mode=0o700)
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(runtime.parent))
    (runtime / "run").write_text(str(folder))
    state = json.loads((folder / "state.json").read_text())
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    me = myself()
    supervisor = {**state["supervisor"], "pid": me.pid, "pgid": me.pgid, "start_s": me.start_s}
    state |= {"run": str(folder), "rt": str(runtime), "boot": boot, "supervisor": supervisor}
    (folder / "state.json").write_text(json.dumps(state))
    return folder


def simulated(name: str, base: int, run: Path) -> Target:
    return Target(
        name=name,
        id=int(name[-1]),
        autopilot=(HOST, base + 4),
        partner=(HOST, base + 5),
        tools=(HOST, base + 6),
        run=run,
    )


def test_land_all_finds_the_vehicles_of_an_old_run(active: Path) -> None:
    expected = (simulated("uav1", 24010, active), simulated("uav2", 24020, active))
    for found in (targets.find(), targets.find(run=active)):
        assert found.targets == expected and [t.run for t in found.targets] == [active, active]
    assert recorded_down(active, ["uav1", "uav2"]) == {}


def test_land_all_finds_the_connections_of_old_real_vehicles() -> None:
    found = {t.name: t for t in targets.find(run=OLD / "hardware").targets}
    urls = {
        "uav1": ConnectionUrl(kind="udpin", host="0.0.0.0", port=14540),
        "uav2": ConnectionUrl(kind="udpout", host="192.168.1.12", port=14550),
        "uav3": ConnectionUrl(kind="serial", device="/dev/ttyUSB0", baud=230400),
    }
    assert {name: t.direct for name, t in found.items()} == {
        "uav1": DirectAddress(
            connection=urls["uav1"], local=("0.0.0.0", 14540), vehicle=("192.168.1.11", 14550)
        ),
        "uav2": DirectAddress(connection=urls["uav2"], vehicle=("192.168.1.12", 14550)),
        "uav3": DirectAddress(connection=urls["uav3"]),
    }
    assert [(t.autopilot[1], t.partner[1], t.tools[1], t.run) for t in found.values()] == [
        (24014 + 10 * k, 24015 + 10 * k, 24016 + 10 * k, None) for k in range(3)
    ]


def test_params_diff_reads_through_the_router_of_an_old_run(active: Path, tmp_path: Path) -> None:
    file = tmp_path / "arena.yaml"
    shutil.copy(Path(__file__).parents[1] / "examples/01_two_quads/arena.yaml", file)
    shutil.copy(Path(__file__).parents[1] / "examples/01_two_quads/position_setpoints.py", tmp_path)
    arena = load_arena(file)
    (run,) = active_runs()
    assert run.live and run.address == HOST
    found = targets_of(arena, arena.vehicles)
    assert {name: (t.system, t.remote) for name, t in found.items()} == {
        "uav1": (1, (HOST, 24016)),
        "uav2": (2, (HOST, 24026)),
    }


def test_a_push_that_was_cut_short_is_of_the_same_place() -> None:
    """The record of a push names the vehicle's connection in these words; --resume compares them."""
    arena = load_arena(OLD / "hardware" / "arena.yaml", ["defaults.profile=iris"])
    assert [address_text(arena, v) for v in arena.vehicles] == [
        "id 1, udpin 0.0.0.0:14540",
        "id 2, udpout 192.168.1.12:14550",
        "id 3, serial /dev/ttyUSB0 at 230400",
    ]


@pytest.mark.parametrize("name", ["two_quads", "hardware"])
def test_an_old_plan_is_read(name: str) -> None:
    plan = Plan.from_json((OLD / name / "plan.json").read_text())
    assert [v.id for v in plan.vehicles] == [*range(1, len(plan.vehicles) + 1)]
    assert {p.name for p in plan.processes} >= {"router", "forward.uav1", "logger.uav1"}


def test_an_old_state_is_read(active: Path) -> None:
    run = open_run(active)
    assert run is not None and run.supervisor.pid == os.getpid() and plan_of(run) is not None
    assert set(run.processes) >= {"world", "mocap", "router", "forward.uav1", "program.uav2"}


@pytest.mark.parametrize("arguments", [(), ("--run",)])
def test_logs_prints_a_log_of_an_old_run(
    active: Path, capfdbinary: pytest.CaptureFixture[bytes], arguments: tuple[str, ...]
) -> None:
    assert main(["logs", "world", *arguments, *([str(active)] if arguments else [])]) == 0
    assert capfdbinary.readouterr().out == (active / "logs" / "world.log").read_bytes()
