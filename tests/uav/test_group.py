"""Programs of a group: one process, one thread per vehicle, or one program for all."""

from __future__ import annotations

import threading

import pytest

from arena.clock import LockstepClock
from arena.errors import InputError, OffboardLostError, RunError, VehicleError
from arena.uav import UAV, vehicle_control
from arena.uav.fleet import Fleet
from arena.uav.group.programs import Group, end_report
from arena.uav.group_clock import GroupClock, GroupThreads, MemberClock

from .test_arguments import slice_file


class FakeClock(LockstepClock):
    """Simulation clock whose time is the last requested wake-up time; the world ends at `ends`."""

    lockstep = True

    def __init__(self, ends: float = 1e9) -> None:
        self.time, self.ends, self.sleeps = 0.0, ends, 0

    def now(self) -> float:
        return self.time

    def sleep_only(self, t: float) -> float:
        self.sleeps += 1
        if t > self.ends:
            raise RunError("the world has ended")
        self.time = max(self.time, t)
        return self.time


def test_threads_of_a_lockstep_group_run_one_at_a_time_in_a_fixed_order():
    world = FakeClock()
    group, seen, running = GroupClock(world), [], []

    def work(name: str, period: float):
        def run() -> None:
            clock = MemberClock(group)
            for _ in range(3):
                running.append(name)
                assert running == [name]
                seen.append((name, round(clock.now(), 3)))
                running.remove(name)
                clock.sleep_until(clock.now() + period)

        return run

    group.run_all([work("a", 0.2), work("b", 0.1), work("c", 0.2)])
    assert seen == [
        ("a", 0.0),
        ("b", 0.0),
        ("c", 0.0),
        ("b", 0.1),
        ("a", 0.2),
        ("c", 0.2),
        ("b", 0.2),
        ("a", 0.4),
        ("c", 0.4),
    ]
    assert world.sleeps == 5  # one sleep of the process per instant, not one per thread


def test_end_of_the_world_ends_every_thread_of_a_group():
    group, errors = GroupClock(FakeClock(ends=1.0)), []

    def run() -> None:
        try:
            group.sleep(2.0)
        except RunError as error:
            errors.append(str(error))

    group.run_all([run] * 3)
    assert errors == ["the world has ended"] * 3


PROGRAM = """
import sys
from arena import UAV
seen = []
with UAV.from_args() as uav:
    name = uav.info.drone_ns
    seen.append(name)
    print(name, seen, uav.args, __name__, flush=True)
    if name == "uav2":
        raise ValueError("broken")
    if name == "uav3":
        sys.exit(5)
"""


def group_of(tmp_path, text: str, *, once: bool = False, count: int = 3):
    (tmp_path / "fly.py").write_text(text)
    members = []
    for number in range(1, count + 1):
        (folder := tmp_path / f"uav{number}").mkdir()
        file = slice_file(folder, vehicle=f"uav{number}", id=number)
        members.append({"vehicle": f"uav{number}", "argv": ["--uav", str(file), f"--row={number}"]})
    settings = {
        "name": "group.show",
        "program": str(tmp_path / "fly.py"),
        "once": once,
        "clock": None,
        "members": members,
    }
    ended: dict[str, tuple[int, str]] = {}
    return Group(settings, lambda vehicle, code, why: ended.update({vehicle: (code, why)})), ended


def test_each_thread_flies_its_own_vehicle_and_a_failure_ends_only_that_one(tmp_path, capsys):
    before = threading.active_count()
    group, ended = group_of(tmp_path, PROGRAM)
    assert group.run() == 1
    assert ended == {"uav1": (0, ""), "uav2": (1, "ValueError: broken"), "uav3": (5, "")}
    said = capsys.readouterr()
    for number in (1, 2, 3):
        assert f"uav{number} ['uav{number}'] ['--row={number}'] __main__" in said.out
    assert "uav2: ValueError: broken" in said.err
    assert "group.show: 2 of 3 programs failed: uav2, uav3" in said.err
    assert threading.active_count() == before  # the connections are closed


def test_one_program_gets_all_vehicles_of_its_group(tmp_path, capsys):
    text = "from arena import UAV\nwith UAV.all_from_args() as fleet:\n    print(fleet.names, len(fleet), fleet[1].args)\n"
    group, ended = group_of(tmp_path, text, once=True)
    assert group.run() == 0 and set(ended) == {"uav1", "uav2", "uav3"}
    assert capsys.readouterr().out == "('uav1', 'uav2', 'uav3') 3 ['--row=2']\n"


class Waits:
    """Module `time` whose time passes only in `sleep`. total_s: sum of all sleeps [s]."""

    total_s = 0.0

    def monotonic(self) -> float:
        return self.total_s

    def sleep(self, seconds: float) -> None:
        self.total_s += seconds


@pytest.mark.parametrize("once", [True, False])
def test_loss_of_one_vehicle_does_not_block_the_program_of_the_others(tmp_path, capsys, monkeypatch, once):
    """The others would receive no setpoints. In lockstep only one thread of a group runs at a time."""
    monkeypatch.setattr(GroupThreads, "lockstep", property(lambda self: True))
    monkeypatch.setattr(vehicle_control, "time", waits := Waits())
    opened = "UAV.all_from_args()" if once else "[UAV.from_args()]"
    text = (
        f"from pathlib import Path\nfrom arena import UAV\ncontrol = {opened}[0].control\n"
        f"control._run = Path({str(tmp_path)!r})\nprint(control._cause())\n"
    )
    group, _ = group_of(tmp_path, text, once=once, count=1)
    assert group.run() == 0
    assert "has not recorded the cause yet" in capsys.readouterr().out
    assert waits.total_s < 0.4


def test_single_and_common_programs_are_not_mixed(tmp_path, capsys):
    group, _ = group_of(tmp_path, "from arena import UAV\nUAV.from_args()\n", once=True)
    assert group.run() == 1 and "Use UAV.all_from_args" in capsys.readouterr().err
    with pytest.raises(InputError, match="run: once"):
        UAV.all_from_args()


class FakeUav:
    """Vehicle that records its setpoints, and is lost at the second one if its name is in `lost`."""

    def __init__(self, name: str, lost: bool) -> None:
        self.info = type("Info", (), {"drone_ns": name})
        self.encoder = type("Encoder", (), {"pos_yaw": staticmethod(lambda pos, yaw, now: (tuple(pos), yaw))})
        self.sent, self.lost = [], lost

    def send(self, message) -> None:
        if self.lost and self.sent:
            raise OffboardLostError(f"{self.info.drone_ns}: a pilot took over")
        self.sent.append(message)

    def hold_until(self, done, timeout) -> bool:
        return True

    def close(self) -> None:
        pass


def test_lost_vehicle_gets_no_more_setpoints_and_the_others_fly_on(capsys):
    uavs = [FakeUav("uav1", False), FakeUav("uav2", True), FakeUav("uav3", False)]
    with (
        pytest.raises(VehicleError, match="1 of 3 vehicles were lost: uav2: a pilot took over"),
        Fleet(uavs, GroupThreads(None, "group.show")) as fleet,
    ):
        for step in range(3):
            fleet.set_pos_yaw([[step, row, -1] for row in range(3)], 0.5, 1000)
        assert list(fleet.lost) == ["uav2"]
        fleet.each(lambda uav: uav.sent.append("done"))
    assert [len(uav.sent) for uav in uavs] == [4, 1, 4]
    assert uavs[2].sent[1] == ((1.0, 2.0, -1.0), 0.5)
    assert "uav2: the program has lost this vehicle" in capsys.readouterr().err


def test_program_that_flies_all_vehicles_reports_its_reason_once():
    """The process `group.NAME` reports its end and the last line of its log."""
    stats = {"exit_code": 1, "exit": "exit 1 (ValueError: no such place)"}
    each = end_report("uav1", 1, "ValueError: no such place", once=False)
    assert each == {"of": "program.uav1", "event": f"EXITED: {stats['exit']}", "stats": stats}
    assert end_report("uav1", 1, "ValueError: no such place", once=True) == {
        "of": "program.uav1",
        "stats": stats,
    }
