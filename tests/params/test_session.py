"""Reading and writing over sockets and serial lines, many vehicles at once."""

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
from pathlib import Path
from typing import Any

import pytest

from arena.autopilot.param_table import SPECS
from arena.errors import InputError
from arena.params.transfer.push_record import Record
from arena.params.transfer.session import Report, SerialParamTransport, Target, pull, push, reboot
from arena.params.transfer.transfer import Progress
from arena.wire.mavlink_frame import parse_frames

from .simulated_vehicle import INT32, Air, Vehicle, holds, others, sixty
from .vehicle_server import BuiltIn, Simulated, own_address, serve


def fleet(*systems: int, **more: Any) -> Simulated:
    return Simulated([Vehicle(system=s, **more) for s in systems])


def same_for(targets: dict[str, Target], wanted: dict[str, float]) -> dict[str, dict[str, float]]:
    return dict.fromkeys(targets, wanted)


# -- simulated vehicles --------------------------------------------------------------------------------------------------------


def test_three_vehicles_are_written_and_read_each_its_own() -> None:
    vehicles = fleet(1, 2, 3)
    with serve(vehicles) as targets:
        wanted = {name: {**others(), "P_01": 100 + i} for i, name in enumerate(targets)}
        reports = push(targets, wanted)
        pulled = pull(targets)
    assert all(report.holds for report in reports.values()), reports
    assert all(holds(v, w) for v, w in zip(vehicles.vehicles, wanted.values(), strict=True))
    assert all(p.whole and len(p.values) == 60 for p in pulled.values())
    assert [p.values["P_01"].value for p in pulled.values()] == [100, 101, 102]


def test_a_rough_air_for_each_of_ten_and_all_end_right() -> None:
    systems = range(1, 11)
    airs = [Air(seed=s, loss=0.1, delay_s=0.1, twice=0.05, late=0.05) for s in systems]
    vehicles = Simulated([Vehicle(system=s) for s in systems], airs)
    with serve(vehicles) as targets:
        wanted = dict(list(others().items())[:25])
        reports = push(targets, same_for(targets, wanted))
    assert all(report.holds for report in reports.values()), {
        n: (r.ending, r.those("lost")) for n, r in reports.items()
    }
    assert all(holds(v, wanted) for v in vehicles.vehicles)
    print("ten in a rough air [s]:", sorted(round(r.traffic.seconds, 1) for r in reports.values()))


def test_one_that_is_not_there_and_one_that_is_armed_do_not_hold_up_the_third(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("arena.params.transfer.transfer.PATIENCE_S", 2.5)
    vehicles = fleet(1, 2, 3)
    vehicles.vehicles[0].alive, vehicles.vehicles[1].armed = False, True
    with serve(vehicles) as targets:
        reports = push(targets, same_for(targets, {"P_03": 9}))
        assert reboot({"uav2": targets["uav2"], "uav3": targets["uav3"]}) == {"uav2": "armed", "uav3": ""}
    assert [r.ending for r in reports.values()] == ["not heard", "armed", "done"]
    assert reports["uav1"].those("untried") == ["P_03"] and reports["uav3"].those("written") == ["P_03"]
    assert not reports["uav2"].holds and [v.told for v in vehicles.vehicles] == [[], [], ["P_03"]]
    assert [v.rebooted for v in vehicles.vehicles] == [0, 0, 1]


def test_what_needs_a_reboot_is_said_only_of_what_was_written() -> None:
    with serve(fleet(1)) as targets:
        wanted = {"uav1": {"P_01": 1, "P_03": 9, "P_05": 6}}
        report = push(targets, wanted, reboot_names=frozenset({"P_01", "P_03", "P_07"}))["uav1"]
    assert report.needs_reboot == ("P_03",)


def test_progress_is_told_of_all_and_at_the_end() -> None:
    told: list[dict[str, Progress]] = []
    with serve(fleet(1, 2)) as targets:
        push(targets, same_for(targets, others()), on_progress=lambda progress: told.append(dict(progress)))
    assert all(set(progress) == {"uav1", "uav2"} for progress in told)
    assert all(p.n == p.of == 180 for p in told[-1].values())


def test_a_vehicle_whose_address_is_not_known_is_met_where_it_speaks_from() -> None:
    host, vehicle, over = own_address(), Vehicle(), threading.Event()

    def speak() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind((host, 14580))
            while not over.is_set():
                for data in vehicle.step(time.monotonic()):
                    sock.sendto(data, (host, 14540))
                if select.select([sock], [], [], 0.01)[0]:
                    for answer in vehicle.hear(sock.recv(65536)):
                        sock.sendto(answer, (host, 14540))

    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    try:
        reports = push({"a": Target(system=1, local=(host, 14540))}, {"a": {"P_03": 9}})
    finally:
        over.set()
        thread.join(10)
    assert reports["a"].holds


def test_an_address_that_is_taken_is_told_and_the_others_go_on() -> None:
    with serve(fleet(1)) as targets, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((own_address(), 14540))
        taken = Target(system=2, local=other.getsockname())
        reports = push({**targets, "uav2": taken}, {"uav1": {"P_03": 9}, "uav2": {"P_03": 9}})
    assert reports["uav1"].holds
    assert reports["uav2"].ending == "not heard" and "Address already in use" in reports["uav2"].why


# -- serial lines --------------------------------------------------------------------------------------------------------------


def test_over_a_serial_line(serial_cable: tuple[str, str]) -> None:
    near, far = serial_cable
    vehicle, over = Vehicle(), threading.Event()
    fd = os.open(far, os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)

    def speak() -> None:
        while not over.is_set():
            for data in vehicle.step(time.monotonic()):
                os.write(fd, data)
            if select.select([fd], [], [], 0.01)[0]:
                for answer in vehicle.hear(os.read(fd, 65536)):
                    os.write(fd, answer)

    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    try:
        targets = {"uav1": Target(system=1, device=near, baud=57600)}
        report, pulled = push(targets, {"uav1": others()})["uav1"], pull(targets)["uav1"]
    finally:
        over.set()
        thread.join(10)
        os.close(fd)
    assert report.holds and holds(vehicle, others()) and pulled.whole


def test_a_device_that_is_unplugged_is_a_vehicle_that_vanishes_and_nobody_spins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("arena.params.transfer.transfer.SILENT_S", 1.0)
    reads, read = [], SerialParamTransport.read
    monkeypatch.setattr(SerialParamTransport, "read", lambda wire: reads.append(1) or read(wire))
    board, device = pty.openpty()
    tty.setraw(device)
    name = os.ttyname(device)

    def speak_and_go() -> None:
        beat, asked = Vehicle().step(0.0)[0], False
        while not asked:
            os.write(board, beat)
            if select.select([board], [], [], 0.05)[0]:
                asked = any(frame.msgid == 20 for frame in parse_frames(os.read(board, 65536)).frames)
        os.close(board)

    thread = threading.Thread(target=speak_and_go, daemon=True)
    thread.start()
    report = push({"uav1": Target(system=1, device=name)}, {"uav1": {"P_03": 9}})["uav1"]
    thread.join(10)
    os.close(device)
    assert report.ending == "vanished" and report.those("untried") == ["P_03"]
    assert len(reads) < 1000


def test_a_device_that_is_not_there_is_told() -> None:
    report = push({"uav1": Target(system=1, device="/dev/none")}, {"uav1": {"P_03": 9}})["uav1"]
    assert report.ending == "not heard" and report.why.startswith("there is no /dev/none: is the cable in")


# -- the record ----------------------------------------------------------------------------------------------------------------


def interrupt_when(vehicle: Vehicle, told: int) -> Any:
    """An on_progress that presses Ctrl-C once so much has been written."""

    def look(_: Any) -> None:
        if len(vehicle.told) >= told:
            raise KeyboardInterrupt

    return look


def test_an_interrupted_push_leaves_a_record_and_is_resumed_from_it(tmp_path: Path) -> None:
    vehicles, file = fleet(1, 2), tmp_path / "push.json"
    first, second = vehicles.vehicles
    vehicles.airs = [Air(delay_s=0.05), Air(delay_s=0.05)]
    with serve(vehicles) as targets:
        wanted = same_for(targets, others())
        reports = push(
            targets, wanted, record=Record.begin(file, wanted), on_progress=interrupt_when(first, 15)
        )
        assert reports["uav1"].ending == reports["uav2"].ending == "interrupted"
        assert reports["uav1"].those("written") and reports["uav1"].those("differs", "lost")
        left = Record.read(file)
        for name, vehicle in (("uav1", first), ("uav2", second)):
            entry = left.entries[name]
            assert entry.wanted == others() and entry.ending == "interrupted"
            assert (
                set(entry.written)
                == set(reports[name].those("written"))
                <= set(vehicle.told)
                <= set(entry.before)
            )
            assert entry.before == pytest.approx({n: v for n, (v, _) in sixty().items()})
        before = {name: list(vehicle.told) for name, vehicle in (("uav1", first), ("uav2", second))}
        again = push(targets, left.wanted, record=left)
    assert all(r.holds for r in again.values()) and holds(first, others()) and holds(second, others())
    assert set(again["uav1"].those("same")) >= set(reports["uav1"].those("written")), (
        "what was written is not written again"
    )
    assert not set(first.told[len(before["uav1"]) :]) & set(reports["uav1"].those("written"))
    assert not file.exists(), "nothing is left to resume"


def test_the_old_values_are_on_disk_before_the_first_is_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "push.json"
    seen: list[set[str]] = []

    class Watched(Vehicle):
        def set(self, name: str, raw: float) -> None:
            seen.append(set(json.loads(file.read_text())["vehicles"]["uav1"]["before"]))
            super().set(name, raw)

    with serve(Simulated([Watched()])) as targets:
        push(targets, {"uav1": others()}, record=Record.begin(file, {"uav1": others()}))
    assert seen and all(names == set(others()) for names in seen)


def test_a_resumed_push_keeps_the_values_from_before_the_first_attempt(tmp_path: Path) -> None:
    record = Record.begin(tmp_path / "push.json", {"a": {"X": 2.0}})
    assert record.note("a", {"X": 1.0}, {}, "") and not record.note("a", {"X": 1.0}, {}, "")
    record.note("a", {"X": 1.0}, {"X": 2.0}, "vanished")
    record.save()
    again = Record.read(record.path)
    assert again.wanted == {"a": {"X": 2.0}}
    again.note("a", {"X": 1.5}, {}, "done")
    assert (
        again.entries["a"].before == {"X": 1.0}
        and again.entries["a"].written == {"X": 2.0}
        and again.wanted == {}
    )


def test_a_vehicle_that_was_not_done_keeps_the_record(tmp_path: Path) -> None:
    vehicles, file = fleet(1, 2), tmp_path / "push.json"
    vehicles.vehicles[1].armed = True
    with serve(vehicles) as targets:
        wanted = same_for(targets, {"P_03": 9})
        push(targets, wanted, record=Record.begin(file, wanted))
    assert Record.read(file).wanted == {"uav2": {"P_03": 9}}


def test_a_record_that_cannot_be_written_stops_it_before_anything_is_set(tmp_path: Path) -> None:
    vehicles = fleet(1)
    with serve(vehicles) as targets, pytest.raises(OSError, match="No such file"):
        push(
            targets,
            {"uav1": others()},
            record=Record.begin(tmp_path / "none" / "push.json", {"uav1": others()}),
        )
    assert vehicles.vehicles[0].told == []


NO_NUMBER = '{"a": {"wanted": {"X": "1"}, "before": {}, "written": {}, "ending": ""}}'


@pytest.mark.parametrize(
    "vehicles", ["", ', "vehicles": []', ', "vehicles": {"a": {}}', f', "vehicles": {NO_NUMBER}']
)
def test_what_is_no_record_is_told(tmp_path: Path, vehicles: str) -> None:
    file = tmp_path / "push.json"
    with pytest.raises(InputError, match="there is no push to resume"):
        Record.read(file)
    for text in ("", "[]", "{}", '{"format": "arena params push 1"' + vehicles + "}"):
        file.write_text(text)
        with pytest.raises(InputError, match="is no record of a push"):
            Record.read(file)


PUSHER = """
import sys
from pathlib import Path
from arena.params.transfer.push_record import Record
from arena.params.transfer.session import Target, push
wanted = {"uav1": eval(sys.argv[3])}
push({"uav1": Target(system=1, remote=eval(sys.argv[2]))}, wanted, record=Record.begin(Path(sys.argv[1]), wanted))
"""


def test_a_process_that_is_killed_while_it_pushes_leaves_a_record_that_is_whole(tmp_path: Path) -> None:
    vehicles, file = Simulated([Vehicle()], [Air(delay_s=0.05)]), tmp_path / "push.json"
    with serve(vehicles) as targets:
        wanted = {"uav1": others()}
        pusher = subprocess.Popen(
            [sys.executable, "-c", PUSHER, str(file), repr(targets["uav1"].remote), repr(others())]
        )
        try:
            deadline = time.monotonic() + 60.0
            while len(vehicles.vehicles[0].told) < 15:
                assert time.monotonic() < deadline and pusher.poll() is None, "nothing is written"
                time.sleep(0.005)
        finally:
            pusher.kill()
            pusher.wait()
        left = Record.read(file)
        assert left.wanted == wanted and set(left.entries["uav1"].before) == set(others())
        assert push(targets, left.wanted, record=left)["uav1"].holds
    assert holds(vehicles.vehicles[0], others())


# -- built-in autopilots -------------------------------------------------------------------------------------------------------


def some_of_the_built_in() -> dict[str, float]:
    """Sixty, integers and floats, each another value that it may have."""
    chosen: dict[str, float] = {}
    for name, spec in SPECS.items():
        for value in (spec.default + 1, spec.default * 0.9 + 0.01, spec.default - 1):
            if spec.low <= value <= spec.high and (spec.type == "float" or value == int(value)):
                chosen[name] = value
                break
    return dict([(n, v) for n, v in chosen.items() if not n.startswith(("MAV_", "SYS_"))][:60])


def written(reports: dict[str, Report], pilots: Any, wanted: dict[str, float]) -> bool:
    return all(
        pilots.params[name][i] == pytest.approx(v) for name, v in wanted.items() for i in range(len(reports))
    )


def test_ten_built_in_autopilots_take_sixty_each_and_list_all_they_have(tmp_path: Path) -> None:
    wanted = some_of_the_built_in()
    assert len(wanted) == 60 and 15 < sum(SPECS[n].type == "int32" for n in wanted) < 45
    flying = BuiltIn(10, tmp_path)
    with serve(flying) as targets:
        alone = push({"uav1": targets["uav1"]}, {"uav1": wanted})["uav1"]
        reports = push(targets, same_for(targets, wanted))
        pulled = pull(targets)
    assert alone.holds and all(r.holds for r in reports.values()), {n: r.ending for n, r in reports.items()}
    assert written(reports, flying.pilots, wanted)
    assert all(p.whole and set(p.values) == set(SPECS) for p in pulled.values())
    print(
        f"one: {alone.traffic}; ten: {max(r.traffic.seconds for r in reports.values()):.2f} s",
        file=sys.stderr,
    )


def test_the_built_in_autopilot_keeps_what_is_out_of_range_and_knows_what_it_does_not_know(
    tmp_path: Path,
) -> None:
    with serve(BuiltIn(1, tmp_path)) as targets:
        wanted = {"EKF2_HGT_REF": 9, "MPC_XY_P": 1.25, "NO_SUCH_NAME": 1, "MPC_Z_P": 1.25}
        report = push(targets, {"uav1": wanted})["uav1"]
    assert {n: r.outcome for n, r in report.results.items()} == {
        "EKF2_HGT_REF": "refused",
        "MPC_XY_P": "written",
        "NO_SUCH_NAME": "unknown",
        "MPC_Z_P": "written",
    }
    assert report.results["EKF2_HGT_REF"].kind == INT32 and report.results["EKF2_HGT_REF"].new != 9
