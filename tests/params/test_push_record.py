"""Tests of the record of a push: values that were sent, but not acknowledged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from fake_autopilot import FakeAutopilot

from arena.params.transfer import transfer
from arena.params.transfer.push_record import PushRecord
from arena.params.transfer.session import push

from .simulated_transfer import sixty_params
from .vehicle_server import serve


class Unacknowledging(FakeAutopilot):
    """An autopilot that receives values of one parameter, but does not answer about it any more.

    silent: name of the parameter; "" after the fault
    obeys: it uses the value
    dies: it sends nothing more
    """

    silent, obeys, dies = "P_03", True, False

    def _answer_param(self, m: Any) -> list[bytes]:
        name = getattr(m, "param_id", "")
        if name != self.silent or (m.get_type() != "PARAM_SET" and name not in self.written_names):
            return super()._answer_param(m)
        before = self.params[name]
        super()._answer_param(m)
        if not self.obeys:
            self.params[name] = before
        self.alive = not self.dies
        return []

    def recover(self) -> None:
        self.silent, self.alive = "", True


def unacknowledging(*, obeys: bool, dies: bool) -> Unacknowledging:
    autopilot = Unacknowledging(params=sixty_params(), telemetry=("HEARTBEAT",), period_s=0.1)
    autopilot.obeys, autopilot.dies = obeys, dies
    return autopilot


@pytest.mark.parametrize("dies", [True, False], ids=["connection lost", "done"])
@pytest.mark.parametrize("obeys", [True, False])
def test_value_without_acknowledgement_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, obeys: bool, dies: bool
) -> None:
    monkeypatch.setattr(transfer, "VEHICLE_TIMEOUT_S", 60.0)
    autopilot, file = unacknowledging(obeys=obeys, dies=dies), tmp_path / "push.json"
    wanted, reboot_names = {"uav1": {"P_03": 9.0}}, frozenset({"P_03"})

    def lose_the_dead(_: object) -> None:
        if not autopilot.alive:
            monkeypatch.setattr(transfer, "VEHICLE_TIMEOUT_S", 0.1)

    with serve([autopilot]) as targets:
        began = PushRecord.begin(file, wanted)
        report = push(targets, wanted, record=began, reboot_names=reboot_names, on_progress=lose_the_dead)[
            "uav1"
        ]
        assert report.ending == ("connection lost" if dies else "done")
        assert report.with_outcome("unanswered") == ["P_03"] and report.needs_reboot == ("P_03",)
        left = PushRecord.read(file)
        assert left.unfinished and left.wanted == wanted
        assert left.vehicles["uav1"].unknown == {"P_03": 9.0} and left.vehicles["uav1"].written == {}
        monkeypatch.setattr(transfer, "VEHICLE_TIMEOUT_S", 60.0)
        autopilot.recover()
        report = push(targets, left.wanted, record=left, reboot_names=reboot_names)["uav1"]
    assert report.holds and autopilot.params["P_03"][0] == 9 and report.needs_reboot == ("P_03",)
    assert report.with_outcome("written") == ([] if obeys else ["P_03"])
    assert not PushRecord.read(file).wanted


def test_unknown_values_are_kept_until_the_vehicle_reports_them(tmp_path: Path) -> None:
    record = PushRecord.begin(tmp_path / "push.json", {"a": {"X": 2.0, "Y": 2.0}})
    record.update("a", {"X": 1.0, "Y": 1.0}, {}, "connection lost", unknown={"X": 2.0, "Y": 2.0})
    record.save()
    again = PushRecord.read(record.path)
    assert again.unfinished and again.vehicles["a"].unknown == {"X": 2.0, "Y": 2.0}
    again.update("a", {}, {}, "done", known={"X"})
    assert again.unfinished and again.vehicles["a"].unknown == {"Y": 2.0}
    again.update("a", {}, {"Y": 2.0}, "done", known={"X", "Y"})
    assert not again.unfinished and not again.wanted


def test_record_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    record = PushRecord.begin(tmp_path / "push.json", {"a": {"X": 2.0}})
    record.update("a", {"X": 1.0}, {"X": 2.0}, "interrupted")
    record.save()
    raw = json.loads(record.path.read_text())
    del raw["vehicles"]["a"]["unknown"]
    record.path.write_text(json.dumps(raw))
    assert PushRecord.read(record.path).vehicles == record.vehicles


def test_resumed_push_is_incomplete_while_it_runs(tmp_path: Path) -> None:
    record = PushRecord.begin(tmp_path / "push.json", {"a": {"X": 2.0, "Y": 2.0}})
    record.update("a", {"X": 1.0, "Y": 1.0}, {"X": 2.0}, "done", unknown={"Y": 2.0})
    record.update(
        "a", {"Y": 1.0}, {}, "", known={"Y"}
    )  # the resumed push has read Y, but has not written it again
    assert record.unfinished and record.wanted
    record.update("a", {"Y": 1.0}, {"Y": 2.0}, "done", known={"Y"})
    assert not record.unfinished and not record.wanted


class Clamping(FakeAutopilot):
    """An autopilot that sets another value than the one in PARAM_SET."""

    def write(self, name: str, raw: float) -> None:
        super().write(name, raw)
        self.params[name] = (5.0, self.params[name][1])


@pytest.mark.parametrize("old", [5.0, 3.0])
def test_refused_value_needs_a_reboot_only_if_it_has_changed(old: float) -> None:
    autopilot = Clamping(params=sixty_params(), telemetry=("HEARTBEAT",), period_s=0.1)
    autopilot.params["P_03"] = (old, autopilot.params["P_03"][1])
    with serve([autopilot]) as targets:
        report = push(targets, {"uav1": {"P_03": 9.0}}, reboot_names=frozenset({"P_03"}))["uav1"]
    assert report.with_outcome("refused") == ["P_03"]
    assert report.needs_reboot == (() if old == 5.0 else ("P_03",))
