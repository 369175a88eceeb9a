"""Download of a log: requests and lost messages, in simulated time; files, over sockets."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink
from served import LossyLink, until

from arena.log_download import session
from arena.log_download.download import Interrupted, LogDownload
from arena.log_download.session import fetch_logs
from arena.wire import mavlink_logs
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from tests.log_download.log_server import LogServer
from tests.params.simulated_transfer import run
from tests.params.vehicle_server import BuiltIn, serve

LOGS = [random.Random(k).randbytes(size) for k, size in enumerate((1_000, 60_007, 90 * 30))]


def vehicle(**changes: Any) -> LogServer:
    usual = {"logs": LOGS, "times": [50, 200, 100], "telemetry": ("HEARTBEAT",), "period_s": 0.5}
    return LogServer(**(usual | changes))


def download(**more: Any) -> LogDownload:
    return LogDownload(system=1, component=200, now=0.0, **more)


def content(core: LogDownload) -> bytes:
    assert core.missing is not None
    found = bytearray(core.missing.size)
    for offset, data in core.take_pieces():
        found[offset : offset + len(data)] = data
    return bytes(found)


def lossy(seed: int) -> LossyLink:
    return LossyLink(seed=seed, loss=0.10, delay_s=0.05, twice=0.05, late=0.05)


def test_messages_are_those_of_pymavlink() -> None:
    codec, theirs = Codec(252, 200), mavlink.MAVLink(None, srcSystem=252, srcComponent=200)
    for seq, ((number, payload), message) in enumerate(
        [
            (mavlink_logs.request_list(7), mavlink.MAVLink_log_request_list_message(7, 1, 0, 0xFFFF)),
            (
                mavlink_logs.request_data(7, 3, 1 << 20, 180),
                mavlink.MAVLink_log_request_data_message(7, 1, 3, 1 << 20, 180),
            ),
            (mavlink_logs.request_end(7), mavlink.MAVLink_log_request_end_message(7, 1)),
        ]
    ):
        theirs.seq = seq
        assert codec.frame(number, payload) == message.pack(theirs)
    data = mavlink.MAVLink_log_entry_message(3, 5, 4, 1_700_000_000, 123_456).pack(theirs)
    data += mavlink.MAVLink_log_data_message(3, 90, 2, b"ab".ljust(90, b"\0")).pack(theirs)
    entry, part = parse_frames(data).frames
    assert mavlink_logs.parse_entry(data, entry) == (3, 123_456, 1_700_000_000, 5)
    assert mavlink_logs.parse_data(data, part) == (3, 90, b"ab")


def test_newest_log_is_downloaded_without_repeated_bytes() -> None:
    core, autopilot = download(), vehicle()
    run(core, autopilot, LossyLink())
    assert core.complete and core.problem == "" and core.entry and core.entry.number == 1
    assert content(core) == LOGS[1]
    assert autopilot.sent == -(-len(LOGS[1]) // 90)


@pytest.mark.parametrize("seed", range(3))
def test_lost_messages_are_requested_again(seed: int) -> None:
    core, autopilot = download(), vehicle()
    run(core, autopilot, lossy(seed))
    assert content(core) == LOGS[1]
    assert autopilot.sent < 1.35 * len(LOGS[1]) / 90, "only missing parts are sent again"


def test_log_is_chosen_by_its_id() -> None:
    core = download(number=2)
    run(core, vehicle(), lossy(1))
    assert content(core) == LOGS[2]
    core = download(number=9)
    run(core, vehicle(), LossyLink())
    assert core.problem == "the vehicle has no log 9, expected one of 0, 1, 2" and not core.complete


def test_list_ends_without_a_download() -> None:
    core, autopilot = download(only_list=True), vehicle()
    run(core, autopilot, lossy(2))
    assert [core.entries[k].size for k in sorted(core.entries)] == [len(log) for log in LOGS]
    assert core.ending == "done" and autopilot.sent == 0


def test_interrupted_download_is_continued() -> None:
    first, autopilot = download(), vehicle()
    with pytest.raises(AssertionError, match="not done"):
        run(first, autopilot, LossyLink(), limit_s=0.2)
    assert first.entry and first.missing and 0 < first.missing.left < len(LOGS[1])
    autopilot.receive(first.stop_request(), 0.2)
    kept, sent = first.take_pieces(), autopilot.sent
    again = download(resume=Interrupted(entry=first.entry, missing=first.missing.ranges))
    run(again, autopilot, LossyLink())
    assert again.resumed and autopilot.sent <= -(-len(LOGS[1]) // 90) + 20
    assert autopilot.sent > sent
    found = bytearray(content(again))
    for offset, data in kept:
        found[offset : offset + len(data)] = data
    assert bytes(found) == LOGS[1]


def test_another_log_is_not_mixed_with_an_interrupted_one() -> None:
    entry = mavlink_logs.LogEntry(1, len(LOGS[1]), 199, 3)
    core = download(resume=Interrupted(entry=entry, missing=((0, 90),)))
    run(core, vehicle(), LossyLink())
    assert not core.resumed and content(core) == LOGS[1]


def test_armed_vehicle_is_not_asked_for_a_log() -> None:
    core, autopilot = download(), vehicle(armed=True)
    run(core, autopilot, LossyLink())
    assert core.ending == "armed"
    assert not [m for m in autopilot.received if m.get_type().startswith("LOG_")]


def test_vehicle_that_arms_ends_the_download() -> None:
    core, autopilot = download(), vehicle(burst=1)

    def arm(now: float) -> None:
        autopilot.armed = now > 2.0

    run(core, autopilot, LossyLink(), each=arm)
    assert core.ending == "armed" and core.missing and core.missing.left > 0


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"sends_list": False}, "the vehicle lists no log"),
        ({"logs": [], "times": []}, "the vehicle lists no log"),
        ({"sends_data": False}, "the vehicle does not send log 1, of which it listed 60007 bytes"),
    ],
)
def test_vehicle_without_answer_ends_the_download(changes: dict[str, Any], problem: str) -> None:
    core = download()
    run(core, vehicle(**changes), LossyLink())
    assert core.problem == problem and core.done


def test_empty_log_is_complete() -> None:
    core = download()
    run(core, vehicle(logs=[b""], times=[1]), LossyLink())
    assert core.complete and core.ending == "done"


# -- files, over sockets -----------------------------------------------------------------------------------------


def test_logs_of_two_vehicles_are_written(tmp_path: Path) -> None:
    servers = [vehicle(system=1, period_s=0.05), vehicle(system=2, logs=[LOGS[2]], times=[9], period_s=0.05)]
    seen: set[str] = set()
    with serve(servers, [lossy_socket(1), lossy_socket(2)]) as targets:
        results = fetch_logs(
            targets, tmp_path / "ulog", on_progress=lambda p: seen.update(each.phase for each in p.values())
        )
    assert {name: r.path and r.path.read_bytes() for name, r in results.items()} == {
        "uav1": LOGS[1],
        "uav2": LOGS[2],
    }
    assert sorted(p.name for p in (tmp_path / "ulog").iterdir()) == ["uav1.ulg", "uav2.ulg"]
    assert seen == {"listing", "kB"}


def lossy_socket(seed: int) -> LossyLink:
    return LossyLink(seed=seed, loss=0.05)


def test_interrupted_file_is_completed_by_the_next_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "_SAVE_PERIOD_S", 0.0)
    server = vehicle(period_s=0.05, burst=2)

    def interrupt(progress: Any) -> None:
        if progress["uav1"].phase == "kB" and progress["uav1"].n > 20:
            raise KeyboardInterrupt

    with serve([server]) as targets:
        (first,) = fetch_logs(targets, tmp_path, on_progress=interrupt).values()
        assert first.ending == "interrupted" and first.path is None and first.missing > 0
        assert {p.name for p in tmp_path.iterdir()} == {"uav1.ulg.part", "uav1.ulg.part.json"}
        until(lambda: server.received[-1].get_type() == "LOG_REQUEST_END")
        sent = server.sent
        (second,) = fetch_logs(targets, tmp_path).values()
    assert second.path and second.path.read_bytes() == LOGS[1]
    assert server.sent - sent < len(LOGS[1]) / 90, "received bytes are not requested again"
    assert {p.name for p in tmp_path.iterdir()} == {"uav1.ulg"}


def test_existing_log_is_kept(tmp_path: Path) -> None:
    (tmp_path / "uav1.ulg").write_bytes(b"old")
    with serve([vehicle(period_s=0.05)]) as targets:
        (result,) = fetch_logs(targets, tmp_path).values()
    assert result.path == tmp_path / "uav1_2.ulg" and (tmp_path / "uav1.ulg").read_bytes() == b"old"


def test_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "ulog").write_text("a file")
    with serve([vehicle(period_s=0.05)]) as targets:
        (result,) = fetch_logs(targets, tmp_path / "ulog").values()
    assert result.path is None and "File exists" in result.why


def test_built_in_autopilot_reports_that_it_has_no_log(tmp_path: Path) -> None:
    (own,) = BuiltIn(1, tmp_path).vehicles()
    with serve([own]) as targets:
        (result,) = fetch_logs(targets, tmp_path).values()
    assert (result.ending, result.why) == ("done", "the vehicle has no log")
