"""Tests of reading and writing over sockets and serial devices, many vehicles at the same time."""

from __future__ import annotations

import json
import os
import pty
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_autopilot import INT32, REQUEST, FakeAutopilot
from rebooting_autopilot import rebooting
from served import Connection, LossyLink, SerialDevice, Served, UdpPort, let_pass
from signing_autopilot import SigningAutopilot

from arena.builtin_parameters import SPECS
from arena.errors import InputError
from arena.params.transfer import transfer, transfer_loop
from arena.params.transfer.push_record import PushRecord
from arena.params.transfer.session import PushReport, pull, push, read_after_reboot, reboot
from arena.params.transfer.transfer import Progress, Transfer
from arena.params.transfer.transfer_loop import Connection as Transfers
from arena.params.transfer.transports import ParamTarget, SerialParamTransport
from arena.signing_key import TimestampFile, read_key, write_new_key
from arena.wire.mavlink_frame import parse_frames

from .simulated_transfer import holds, new_values, sixty_params, vehicle
from .vehicle_server import BuiltIn, own_address, serve


def fleet(*systems: int) -> list[FakeAutopilot]:
    return [vehicle(s) for s in systems]


def same_for(targets: dict[str, ParamTarget], wanted: dict[str, float]) -> dict[str, dict[str, float]]:
    return dict.fromkeys(targets, wanted)


# -- simulated vehicles --------------------------------------------------------------------------------------------------------


def test_three_vehicles_get_their_own_values() -> None:
    vehicles = fleet(1, 2, 3)
    with serve(vehicles) as targets:
        wanted = {name: {**new_values(), "P_01": 100 + i} for i, name in enumerate(targets)}
        reports = push(targets, wanted)
        pulled = pull(targets)
    assert all(report.holds for report in reports.values()), reports
    assert all(holds(v, w) for v, w in zip(vehicles, wanted.values(), strict=True))
    assert all(p.complete and len(p.values) == 60 for p in pulled.values())
    assert [p.values["P_01"].value for p in pulled.values()] == [100, 101, 102]


def test_ten_vehicles_over_lossy_links() -> None:
    systems = range(1, 11)
    links = [LossyLink(seed=s, loss=0.1, delay_s=0.1, twice=0.05, late=0.05) for s in systems]
    vehicles = fleet(*systems)
    with serve(vehicles, links) as targets:
        wanted = dict(list(new_values().items())[:25])
        reports = push(targets, same_for(targets, wanted))
    assert all(report.holds for report in reports.values()), {
        n: (r.ending, r.with_outcome("unanswered")) for n, r in reports.items() if not r.holds
    }
    assert all(holds(v, wanted) for v in vehicles)
    print("ten over lossy links [s]:", sorted(round(r.traffic.seconds, 1) for r in reports.values()))


def test_missing_and_armed_vehicles_do_not_delay_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The missing vehicle is given up when the transfers of the others have ended, and not before."""
    monkeypatch.setattr(transfer, "CONNECT_TIMEOUT_S", 60.0)
    vehicles, over, update = fleet(1, 2, 3), set(), Transfer._update
    vehicles[0].alive, vehicles[1].armed = False, True

    def give_up(one: Transfer, now: float) -> None:
        if one.system == 1 and over == {2, 3}:
            now += 60.0
        update(one, now)
        if one.done:
            over.add(one.system)

    with serve(vehicles) as targets:
        with monkeypatch.context() as patch:
            patch.setattr(Transfer, "_update", give_up)
            reports = push(targets, same_for(targets, {"P_03": 9}))
        assert reboot({"uav2": targets["uav2"], "uav3": targets["uav3"]}) == {"uav2": "armed", "uav3": ""}
    assert [r.ending for r in reports.values()] == ["no connection", "armed", "done"]
    assert reports["uav1"].with_outcome("unread") == ["P_03"] and reports["uav3"].with_outcome("written") == [
        "P_03"
    ]
    assert not reports["uav2"].holds and [v.written_names for v in vehicles] == [[], [], ["P_03"]]
    assert [v.rebooted for v in vehicles] == [0, 0, 1]


def test_only_written_parameters_need_a_reboot() -> None:
    with serve(fleet(1)) as targets:
        wanted = {"uav1": {"P_01": 1, "P_03": 9, "P_05": 6}}
        report = push(targets, wanted, reboot_names=frozenset({"P_01", "P_03", "P_07"}))["uav1"]
    assert report.needs_reboot == ("P_03",)


def test_resumed_push_needs_the_reboot_of_earlier_writes(tmp_path: Path) -> None:
    with serve(fleet(1)) as targets:
        wanted = {"uav1": {"P_01": 1, "P_03": 9, "P_05": 6}}
        record = PushRecord.begin(tmp_path / "push.json", wanted)
        record.update("uav1", {"P_01": 0}, {"P_01": 1}, "interrupted")
        report = push(targets, wanted, record=record, reboot_names=frozenset({"P_01", "P_03"}))["uav1"]
    assert report.with_outcome("same") == ["P_01"] and report.needs_reboot == ("P_01", "P_03")


def test_progress_is_reported_for_all_and_at_the_end() -> None:
    reported: list[dict[str, Progress]] = []
    with serve(fleet(1, 2)) as targets:
        push(
            targets,
            same_for(targets, new_values()),
            on_progress=lambda progress: reported.append(dict(progress)),
        )
    assert all(set(progress) == {"uav1", "uav2"} for progress in reported)
    assert all(p.n == p.of == 180 for p in reported[-1].values())


def test_unknown_address_is_taken_from_the_first_packet() -> None:
    host = own_address()
    sending = Connection(autopilot=vehicle(), port=UdpPort((host, 14580)), remote=(host, 14540))
    with Served([sending]):
        reports = push({"a": ParamTarget(system=1, local=(host, 14540))}, {"a": {"P_03": 9}})
    assert reports["a"].holds


def test_address_in_use_ends_that_vehicle_only() -> None:
    with serve(fleet(1)) as targets, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((own_address(), 14540))
        taken = ParamTarget(system=2, local=other.getsockname())
        reports = push({**targets, "uav2": taken}, {"uav1": {"P_03": 9}, "uav2": {"P_03": 9}})
    assert reports["uav1"].holds
    assert reports["uav2"].ending == "no connection" and "Address already in use" in reports["uav2"].why


# -- serial devices --------------------------------------------------------------------------------------------------------------


def test_serial_device(serial_cable: tuple[str, str]) -> None:
    near, far = serial_cable
    autopilot = vehicle()
    with Served([Connection(autopilot=autopilot, port=SerialDevice(far))]):
        targets = {"uav1": ParamTarget(system=1, device=near, baud=57600)}
        report, pulled = push(targets, {"uav1": new_values()})["uav1"], pull(targets)["uav1"]
    assert report.holds and holds(autopilot, new_values()) and pulled.complete


def test_unplugged_device_ends_as_connection_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(transfer, "VEHICLE_TIMEOUT_S", 60.0)
    reads, read = [], SerialParamTransport.read
    monkeypatch.setattr(SerialParamTransport, "read", lambda wire: reads.append(1) or read(wire))
    over_at_close, close = [], Transfers.close

    def closed(connection: Any) -> None:
        over_at_close.append(connection.transfer.done)
        close(connection)
        monkeypatch.setattr(transfer, "VEHICLE_TIMEOUT_S", 0.0)

    monkeypatch.setattr(Transfers, "close", closed)
    board, device = pty.openpty()
    tty.setraw(device)
    name = os.ttyname(device)

    def answer_once() -> None:
        heartbeat, asked = vehicle().step(0.0)[0], False
        while not asked:
            os.write(board, heartbeat)
            if select.select([board], [], [], 0.05)[0]:
                asked = any(frame.msgid == 20 for frame in parse_frames(os.read(board, 65536)).frames)
        os.close(board)

    thread = threading.Thread(target=answer_once, daemon=True)
    thread.start()
    report = push({"uav1": ParamTarget(system=1, device=name)}, {"uav1": {"P_03": 9}})["uav1"]
    thread.join(10)
    os.close(device)
    assert report.ending == "connection lost" and report.with_outcome("unread") == ["P_03"]
    assert len(reads) < 1000
    assert over_at_close == [False, True], "the device is closed at once, so that it can get its name again"


def test_pause_of_this_computer_is_no_lost_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    """The messages of the vehicle wait in the socket, and are read before the time-out is checked."""
    autopilot, pauses, read = vehicle(), [], Transfers.read

    def read_then_pause(connection: Any) -> None:
        read(connection)
        if autopilot.written_names and not pauses:
            let_pass(autopilot, 2)
            pauses.append(10.0 * transfer.VEHICLE_TIMEOUT_S)

    monkeypatch.setattr(Transfers, "read", read_then_pause)
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + sum(pauses))
    monkeypatch.setattr(transfer_loop, "time", clock)
    with serve([autopilot]) as targets:
        report = push(targets, same_for(targets, new_values()))["uav1"]
    assert pauses and report.holds, report


def test_device_that_disappears_in_the_reboot_is_opened_again(
    serial_cable: tuple[str, str], tmp_path: Path
) -> None:
    near, far = serial_cable
    device, began = tmp_path / "ttyACM0", time.monotonic()
    board, slave = pty.openpty()
    device.symlink_to(os.ttyname(slave))
    os.close(slave)
    autopilot = rebooting(params=sixty_params(), age_s=0.0)

    def come_back() -> None:
        device.unlink()
        os.close(board)  # the device hangs up
        time.sleep(1.0)
        device.symlink_to(near)

    timer = threading.Timer(0.5, come_back)
    timer.start()
    with Served([Connection(autopilot=autopilot, port=SerialDevice(far))]):
        targets = {"uav1": ParamTarget(system=1, device=str(device))}
        names = {"uav1": ["P_03"]}
        found = read_after_reboot(targets, names, requested_at=began, limit_s=30.0)["uav1"]
    timer.join()
    assert found.complete and found.values["P_03"].value == 3


def test_missing_device_is_reported() -> None:
    report = push({"uav1": ParamTarget(system=1, device="/dev/none")}, {"uav1": {"P_03": 9}})["uav1"]
    assert report.ending == "no connection" and report.why.startswith(
        "there is no /dev/none: is the cable in"
    )


# -- the record ----------------------------------------------------------------------------------------------------------------


def interrupt_when(condition: Callable[[], object]) -> Any:
    """Return an on_progress that raises KeyboardInterrupt once the condition holds."""

    def interrupt(_: Any) -> None:
        if condition():
            raise KeyboardInterrupt

    return interrupt


def test_interrupted_push_is_resumed_from_its_record(tmp_path: Path) -> None:
    vehicles, file = fleet(1, 2), tmp_path / "push.json"
    first, second = vehicles
    with serve(vehicles, [LossyLink(delay_s=0.05), LossyLink(delay_s=0.05)]) as targets:
        wanted = same_for(targets, new_values())
        both_write = interrupt_when(lambda: len(first.written_names) >= 15 and second.written_names)
        reports = push(targets, wanted, record=PushRecord.begin(file, wanted), on_progress=both_write)
        assert reports["uav1"].ending == reports["uav2"].ending == "interrupted"
        assert reports["uav1"].with_outcome("written") and reports["uav1"].with_outcome(
            "differs", "unanswered"
        )
        left = PushRecord.read(file)
        for name, autopilot in (("uav1", first), ("uav2", second)):
            entry = left.vehicles[name]
            assert entry.wanted == new_values() and entry.ending == "interrupted"
            assert (
                set(entry.written)
                == set(reports[name].with_outcome("written"))
                <= set(autopilot.written_names)
                <= set(entry.before)
            )
            assert entry.before == pytest.approx({n: v for n, (v, _) in sixty_params().items()})
        before = {
            name: list(autopilot.written_names) for name, autopilot in (("uav1", first), ("uav2", second))
        }
        again = push(targets, left.wanted, record=left)
    assert all(r.holds for r in again.values()) and holds(first, new_values()) and holds(second, new_values())
    assert set(again["uav1"].with_outcome("same")) >= set(reports["uav1"].with_outcome("written")), (
        "written values are not written again"
    )
    assert not set(first.written_names[len(before["uav1"]) :]) & set(reports["uav1"].with_outcome("written"))
    assert not PushRecord.read(file).wanted, "nothing is left to resume"


def test_old_values_are_saved_before_the_first_write(tmp_path: Path) -> None:
    file = tmp_path / "push.json"
    seen: list[set[str]] = []
    sent: list[set[str]] = []

    class Watched(FakeAutopilot):
        def write(self, name: str, raw: float) -> None:
            saved = json.loads(file.read_text())["vehicles"]["uav1"]
            seen.append(set(saved["before"]))
            sent.append(set(saved["unknown"]))
            super().write(name, raw)

        def receive(self, data: bytes, now: float) -> list[bytes]:
            answers = super().receive(data, now)
            reads = sum(m.get_type() == "PARAM_REQUEST_READ" for m in self.received)
            # The old values are saved then, and the next save that can wait is due in 0.5 s.
            self.telemetry = ("ATTITUDE",) if reads < len(self.params) else ("HEARTBEAT",)
            return answers

    with serve([Watched(params=sixty_params(), telemetry=("ATTITUDE",))]) as targets:
        push(targets, {"uav1": new_values()}, record=PushRecord.begin(file, {"uav1": new_values()}))
    assert seen and all(names == set(new_values()) for names in seen)
    assert sent[0], "the record also says that a value was sent"


def test_resumed_record_keeps_the_oldest_values(tmp_path: Path) -> None:
    record = PushRecord.begin(tmp_path / "push.json", {"a": {"X": 2.0}})
    assert record.update("a", {"X": 1.0}, {}, "") and not record.update("a", {"X": 1.0}, {}, "")
    record.update("a", {"X": 1.0}, {"X": 2.0}, "connection lost")
    record.save()
    again = PushRecord.read(record.path)
    assert again.wanted == {"a": {"X": 2.0}}
    again.update("a", {"X": 1.5}, {}, "done")
    assert (
        again.vehicles["a"].before == {"X": 1.0}
        and again.vehicles["a"].written == {"X": 2.0}
        and again.wanted == {}
    )


def test_unfinished_vehicle_keeps_the_record(tmp_path: Path) -> None:
    vehicles, file = fleet(1, 2), tmp_path / "push.json"
    vehicles[1].armed = True
    with serve(vehicles) as targets:
        wanted = same_for(targets, {"P_03": 9})
        push(targets, wanted, record=PushRecord.begin(file, wanted))
    assert PushRecord.read(file).wanted == {"uav2": {"P_03": 9}}


def test_resume_of_one_vehicle_keeps_the_record_of_the_others(tmp_path: Path) -> None:
    vehicles, file = fleet(1, 2), tmp_path / "push.json"
    with serve(vehicles) as targets:
        record = PushRecord.begin(file, same_for(targets, {"P_03": 9}))
        for name in targets:
            record.update(name, {"P_03": 3, "P_05": 5}, {"P_05": 6}, "interrupted")
        record.save()
        resumed = PushRecord.read(file)
        assert push(targets, {"uav1": {"P_03": 9}}, record=resumed)["uav1"].holds
        left = PushRecord.read(file)
        assert left.unfinished and left.wanted == {"uav2": {"P_03": 9}}
        assert left.vehicles["uav2"].before == {"P_03": 3, "P_05": 5}
        assert push(targets, left.wanted, record=left)["uav2"].holds
    assert not PushRecord.read(file).wanted


def test_unwritable_record_stops_before_the_first_write(tmp_path: Path) -> None:
    vehicles = fleet(1)
    with serve(vehicles) as targets, pytest.raises(OSError, match="No such file"):
        push(
            targets,
            {"uav1": new_values()},
            record=PushRecord.begin(tmp_path / "none" / "push.json", {"uav1": new_values()}),
        )
    assert vehicles[0].written_names == []


NO_NUMBER = '{"a": {"wanted": {"X": "1"}, "before": {}, "written": {}, "ending": ""}}'


@pytest.mark.parametrize(
    "vehicles", ["", ', "vehicles": []', ', "vehicles": {"a": {}}', f', "vehicles": {NO_NUMBER}']
)
def test_file_that_is_no_record_is_refused(tmp_path: Path, vehicles: str) -> None:
    file = tmp_path / "push.json"
    with pytest.raises(InputError, match="there is no push to resume"):
        PushRecord.read(file)
    for text in ("", "[]", "{}", '{"format": "arena params push 1"' + vehicles + "}"):
        file.write_text(text)
        with pytest.raises(InputError, match="is not the record of `arena params push`"):
            PushRecord.read(file)


PUSHER = """
import sys
from collections.abc import Callable
from pathlib import Path
from arena.params.transfer.push_record import PushRecord
from arena.params.transfer.session import push
from arena.params.transfer.transports import ParamTarget
wanted = {"uav1": eval(sys.argv[3])}
push({"uav1": ParamTarget(system=1, remote=eval(sys.argv[2]))}, wanted, record=PushRecord.begin(Path(sys.argv[1]), wanted))
"""


def test_killed_process_leaves_a_complete_record(tmp_path: Path) -> None:
    vehicles, file = fleet(1), tmp_path / "push.json"
    with serve(vehicles, [LossyLink(delay_s=0.05)]) as targets:
        wanted = {"uav1": new_values()}
        pusher = subprocess.Popen(
            [sys.executable, "-c", PUSHER, str(file), repr(targets["uav1"].remote), repr(new_values())]
        )
        try:
            deadline = time.monotonic() + 60.0
            while len(vehicles[0].written_names) < 15:
                assert time.monotonic() < deadline and pusher.poll() is None, "nothing is written"
                time.sleep(0.005)
        finally:
            pusher.kill()
            pusher.wait()
        left = PushRecord.read(file)
        assert left.wanted == wanted and set(left.vehicles["uav1"].before) == set(new_values())
        assert push(targets, left.wanted, record=left)["uav1"].holds
    assert holds(vehicles[0], new_values())


# -- identity --------------------------------------------------------------------------------------------------------------

OURS, OTHER = bytes(range(1, 19)), bytes(range(101, 119))


def with_uid(targets: dict[str, ParamTarget], uid: bytes) -> dict[str, ParamTarget]:
    return {name: replace(target, uid=uid.hex()) for name, target in targets.items()}


def test_review_fault_4_another_vehicle_is_not_written_to_read_or_rebooted() -> None:
    vehicles = fleet(1)
    vehicles[0].uid2 = OTHER
    with serve(vehicles) as targets:
        ours = with_uid(targets, OURS)
        report = push(ours, same_for(ours, new_values()))["uav1"]
        assert report.ending == "wrong vehicle"
        assert report.why == f"another vehicle answers: hardware uid {OTHER.hex()}, expected {OURS.hex()}"
        assert pull(ours)["uav1"].values == {}
        assert "another vehicle" in reboot(ours)["uav1"]
    assert vehicles[0].written_names == [] and vehicles[0].rebooted == 0
    assert {m.get_type() for m in vehicles[0].received} == {"HEARTBEAT", "COMMAND_LONG"}
    assert {c.command for c in vehicles[0].commands} == {REQUEST}


def test_review_fault_4_a_resumed_push_is_to_the_same_vehicle(tmp_path: Path) -> None:
    vehicles, file, wanted = fleet(1), tmp_path / "push.json", {"uav1": new_values()}
    vehicles[0].uid2 = OURS
    with serve(vehicles, [LossyLink(delay_s=0.05)]) as targets:
        stop = interrupt_when(lambda: len(vehicles[0].written_names) >= 15)
        report = push(targets, wanted, record=PushRecord.begin(file, wanted), on_progress=stop)["uav1"]
        assert (report.ending, report.uid) == ("interrupted", OURS.hex())
        left = PushRecord.read(file)
        assert left.vehicles["uav1"].uid == OURS.hex()
        let_pass(vehicles[0], 2)  # the last writes of the first push arrive
        written = len(vehicles[0].written_names)
        vehicles[0].uid2 = OTHER
        assert push(targets, left.wanted, record=left)["uav1"].ending == "wrong vehicle"
        assert len(vehicles[0].written_names) == written
        vehicles[0].uid2 = OURS
        assert push(targets, left.wanted, record=PushRecord.read(file))["uav1"].holds


def test_a_vehicle_without_autopilot_version_is_written_to_unless_its_uid_is_known() -> None:
    vehicles = fleet(1)
    vehicles[0].ignore = {REQUEST}
    with serve(vehicles) as targets:
        report = push(with_uid(targets, OURS), same_for(targets, {"P_03": 9}))["uav1"]
        assert report.ending == "wrong vehicle" and "does not report its hardware uid" in report.why
        assert push(targets, same_for(targets, {"P_03": 9}))["uav1"].holds


# -- built-in autopilots -------------------------------------------------------------------------------------------------------


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    write_new_key(tmp_path / "uav1.key")
    return tmp_path / "uav1.key"


def test_vehicle_with_a_signing_key_is_written_to_with_this_key_only(key_file: Path, tmp_path: Path) -> None:
    fake = vehicle(1)
    board = SigningAutopilot(fake, read_key(key_file))
    with serve_signing(board) as target:
        unsigned = pull({"uav1": target}, names=["P_01"])["uav1"]
        assert not unsigned.values and board.accepted == 0
        write_new_key(tmp_path / "other.key")
        other = pull({"uav1": replace(target, key_file=str(tmp_path / "other.key"))}, names=["P_01"])["uav1"]
        assert other.ending == "no connection" and board.accepted == 0
        signing = {"uav1": replace(target, key_file=str(key_file))}
        first = push(signing, {"uav1": new_values()})["uav1"]
        second = pull(signing)["uav1"]
        assert reboot(signing) == {"uav1": ""}
    assert first.holds and holds(fake, new_values())
    assert second.complete and len(second.values) == 60
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in fake.received} == {(252, 190)}
    assert TimestampFile(key_file).first() > 0  # the next process signs with newer timestamps


def test_unreadable_signing_key_ends_that_vehicle_only(key_file: Path) -> None:
    key_file.chmod(0o644)
    with serve(fleet(1, 2)) as targets:
        targets["uav1"] = replace(targets["uav1"], key_file=str(key_file))
        reports = pull(targets, names=["P_01"])
    assert reports["uav2"].complete
    assert "other users can use it (mode 0644, expected 0600)" in reports["uav1"].why


@contextmanager
def serve_signing(board: SigningAutopilot) -> Iterator[ParamTarget]:
    """Serve a vehicle that signs, and yield its address without a key."""
    port = UdpPort((own_address(), 24016))
    with Served([Connection(autopilot=board, port=port)]):
        yield ParamTarget(system=board.inner.system, remote=port.address)


def some_of_the_built_in() -> dict[str, float]:
    """Return 60 parameters, integers and floats, each with another allowed value."""
    chosen: dict[str, float] = {}
    for name, spec in SPECS.items():
        for value in (spec.default + 1, spec.default * 0.9 + 0.01, spec.default - 1):
            if spec.low <= value <= spec.high and (spec.type == "float" or value == int(value)):
                chosen[name] = value
                break
    return dict([(n, v) for n, v in chosen.items() if not n.startswith(("MAV_", "SYS_"))][:60])


def written(reports: dict[str, PushReport], pilots: Any, wanted: dict[str, float]) -> bool:
    return all(
        pilots.params[name][i] == pytest.approx(v) for name, v in wanted.items() for i in range(len(reports))
    )


def test_ten_built_in_autopilots_take_sixty_parameters_each(tmp_path: Path) -> None:
    wanted = some_of_the_built_in()
    assert len(wanted) == 60 and 15 < sum(SPECS[n].type == "int32" for n in wanted) < 45
    flying = BuiltIn(10, tmp_path)
    with serve(flying.vehicles()) as targets:
        alone = push({"uav1": targets["uav1"]}, {"uav1": wanted})["uav1"]
        reports = push(targets, same_for(targets, wanted))
        pulled = pull(targets)
    assert alone.holds and all(r.holds for r in reports.values()), {n: r.ending for n, r in reports.items()}
    assert written(reports, flying.pilots, wanted)
    assert all(p.complete and set(p.values) == set(SPECS) for p in pulled.values())
    print(
        f"one: {alone.traffic}; ten: {max(r.traffic.seconds for r in reports.values()):.2f} s",
        file=sys.stderr,
    )


def test_built_in_autopilot_refuses_out_of_range_and_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arena.params.transfer.request_window._MIN_TIMEOUT_S", 0.05)
    with serve(BuiltIn(1, tmp_path).vehicles()) as targets:
        wanted = {"EKF2_HGT_REF": 9, "MPC_XY_P": 1.25, "NO_SUCH_NAME": 1, "MPC_Z_P": 1.25}
        report = push(targets, {"uav1": wanted})["uav1"]
    assert {n: r.outcome for n, r in report.results.items()} == {
        "EKF2_HGT_REF": "refused",
        "MPC_XY_P": "written",
        "NO_SUCH_NAME": "unknown",
        "MPC_Z_P": "written",
    }
    assert report.results["EKF2_HGT_REF"].kind == INT32 and report.results["EKF2_HGT_REF"].new != 9
