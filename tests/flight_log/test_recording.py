"""Reader of flight.mcap, compared with the package `mcap` as an independent reader."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from record_files import UAV1, UAV2, ZSTD_MAGIC, RecordFile, damage_second_chunk

from arena.errors import InputError
from arena.flight_log.record_completion import complete_record
from arena.flight_log.recording import Recording
from arena.mocap.client import CapturedFrame, Pose
from arena.recorder.mcap_file import FLUSHES_PER_CHUNK
from arena.wire.truth_page import Truth

POSE = Pose("body1", (0.1, -0.2, -1.3), (0.9, 0.1, -0.3, 0.3))


def truth(value: float) -> Truth:
    """Return the true state of one vehicle whose numbers all differ."""
    row = np.concatenate([[value], value + np.arange(24.0)])
    return Truth.from_row(row)


def made(path: Path) -> Path:
    record = RecordFile(path)
    for i in range(2000):
        record.channels.on_datagrams([("uav1", i % 3 == 0, b"datagram %d" % i, 0.001 * i)])
        record.channels.on_datagrams([("uav2", False, b"other %d" % i, 0.001 * i)])
        if i % 500 == 0:
            record.end_chunk()
    frame = CapturedFrame(number=5, time_s=1.25, poses=(POSE,), untracked=("body2",), sent_s=None)
    record.channels.on_frame(frame, True, 1.3)
    for k in range(3):
        record.channels.on_truth(truth(float(k)), 0.1 * k)
    record.channels.on_event(b'{"process": "router", "event": "uav1: armed"}', {}, 1.4)
    record.channels.on_event(b"not JSON", {}, 1.5)
    record.close()
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("record") / "flight.mcap")


def test_metadata_describe_the_arena(path):
    record = Recording(path)
    assert (record.name, record.clock, record.size_m) == ("lab", "simulation", (8.0, 6.0, 3.0))
    assert (record.start_s, record.start_unix_s) == (0.5, 1.7e9)
    assert record.vehicles == (UAV1, UAV2)


def test_datagrams_are_read_in_order_with_their_direction(path):
    found = list(Recording(path).datagrams("uav1"))
    assert [d.data for d in found] == [b"datagram %d" % i for i in range(2000)]
    assert [d.up for d in found] == [i % 3 == 0 for i in range(2000)]
    assert [d.time_s for d in found] == [round(0.001 * i, 6) for i in range(2000)]


def test_frames_keep_tracked_and_untracked_bodies(path):
    (frame,) = Recording(path).frames()
    assert (frame.time_s, frame.number, frame.exposed_s, frame.simulated) == (1.3, 5, 1.25, True)
    assert math.isnan(frame.sent_s)
    assert [(b.name, b.tracked) for b in frame.bodies] == [("body1", True), ("body2", False)]
    assert (frame.bodies[0].p_n, frame.bodies[0].q_nb) == (POSE.p_n, POSE.q_nb)


def test_true_states_are_exact(path):
    found = Recording(path).truth("uav1")
    assert found.t.tolist() == [0.0, 0.1, 0.2]
    for k in range(3):
        given = truth(float(k))
        for name in ("p_n", "v_n", "q_nb", "omega_b"):
            np.testing.assert_array_equal(getattr(found, name)[k], getattr(given, name)[0])


def test_real_vehicle_has_no_true_states(path):
    assert Recording(path).truth("uav2").p_n.shape == (0, 3)


def test_events_are_the_lines_that_are_json(path):
    (event,) = Recording(path).events()
    assert (event.time_s, event.process, event.text) == (1.4, "router", "uav1: armed")


def test_package_mcap_reads_the_same_messages(path):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        other = [
            (c.topic, m.log_time / 1e9, m.data) for _, c, m in reader.iter_messages(log_time_order=False)
        ]
        summary = reader.get_summary()
    own = list(Recording(path).messages())
    assert sorted(other) == sorted(tuple(message) for message in own)
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == len(own) == 4006


@pytest.mark.parametrize("lost", [1, 100, 3000, 20000])
def test_truncated_record_is_read_up_to_its_last_complete_chunk(path, tmp_path, lost):
    whole = list(Recording(path).messages())
    (tmp_path / "flight.mcap").write_bytes(path.read_bytes()[:-lost])
    found = list(Recording(tmp_path / "flight.mcap").messages())
    assert found == whole[: len(found)]
    assert len(found) >= 2000


def test_zeros_after_a_power_loss_end_the_record(path, tmp_path):
    data = path.read_bytes()
    (tmp_path / "flight.mcap").write_bytes(data[: len(data) // 2] + bytes(len(data) // 2))
    whole = list(Recording(path).messages())
    record = Recording(tmp_path / "flight.mcap")
    found = list(record.messages())
    assert found == whole[: len(found)]
    assert len(found) >= 1000
    assert record.damaged_chunks == 1


def test_damaged_chunk_is_skipped_and_counted(path, tmp_path):
    shutil.copy(path, tmp_path / "flight.mcap")
    damage_second_chunk(tmp_path / "flight.mcap")
    record = Recording(tmp_path / "flight.mcap")
    whole, found = set(Recording(path).messages()), set(record.messages())
    assert found < whole
    assert len(found) >= 2000
    assert record.damaged_chunks == 1


@pytest.mark.parametrize("flushes", [1, FLUSHES_PER_CHUNK - 1, FLUSHES_PER_CHUNK, 3 * FLUSHES_PER_CHUNK + 2])
def test_record_of_a_killed_recorder_contains_each_flushed_message_once(tmp_path, flushes):
    _, written = killed(tmp_path, flushes)
    assert numbers(tmp_path / "flight.mcap") == written
    assert complete_record(tmp_path / "flight.mcap")
    assert numbers(tmp_path / "flight.mcap") == written
    assert [p.name for p in tmp_path.iterdir()] == ["flight.mcap"]


def test_tail_is_not_read_if_its_messages_are_in_the_record(tmp_path):
    tail, _ = killed(tmp_path / "before", FLUSHES_PER_CHUNK - 1)
    _, written = killed(tmp_path / "after", FLUSHES_PER_CHUNK)
    # The power was lost after the chunk was written, and before the tail began again.
    (tmp_path / "after" / "flight.mcap.tail").write_bytes(tail)
    assert numbers(tmp_path / "after" / "flight.mcap") == written


@pytest.mark.parametrize("zeros", [False, True])
def test_tail_replaces_a_chunk_that_was_not_written_completely(tmp_path, zeros):
    tail, written = killed(tmp_path / "before", 3 * FLUSHES_PER_CHUNK - 1)
    killed(tmp_path / "after", 3 * FLUSHES_PER_CHUNK)
    path = tmp_path / "after" / "flight.mcap"
    whole = path.read_bytes()
    kept = whole.rindex(ZSTD_MAGIC) + 20
    path.write_bytes(whole[:kept] + (bytes(len(whole) - kept) if zeros else b""))
    path.with_name("flight.mcap.tail").write_bytes(tail)
    assert numbers(path) == written
    assert complete_record(path)
    assert numbers(path) == written


def killed(folder: Path, flushes: int) -> tuple[bytes, list[int]]:
    """Make the files of a recorder that was killed after some flushes. Return the tail, and the numbers of the datagrams."""
    record = RecordFile(folder / "flight.mcap")
    for number in range(10 * flushes):
        record.channels.on_datagrams([("uav1", False, b"%d" % number, 0.1 * number)])
        if number % 10 == 9:
            record.file.flush()
    wait_for(lambda: not record.file.busy)
    kept = {p: p.read_bytes() for p in folder.iterdir()}
    record.close()
    for path, data in kept.items():
        path.write_bytes(data)
    return kept[folder / "flight.mcap.tail"], [*range(10 * flushes)]


def numbers(path: Path) -> list[int]:
    return [int(d.data) for d in Recording(path).datagrams("uav1")]


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.001)


def test_parts_of_a_restarted_recorder_are_one_record(tmp_path):
    for number in range(3):
        record = RecordFile(tmp_path / "flight.mcap")
        record.channels.on_datagrams([("uav1", False, bytes([number]), float(number))])
        record.close()
    assert {p.name for p in tmp_path.iterdir()} == {"flight.mcap", "flight.2.mcap", "flight.3.mcap"}
    assert [d.data for d in Recording(tmp_path / "flight.mcap").datagrams("uav1")] == [b"\0", b"\1", b"\2"]


@pytest.mark.parametrize("content", [b"", b"time.seconds,\n", b"\x89MCAP0\r\n"])
def test_other_file_is_an_input_error(tmp_path, content):
    (tmp_path / "flight.mcap").write_bytes(content)
    with pytest.raises(InputError, match=r"flight\.mcap"):
        Recording(tmp_path / "flight.mcap")


def test_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        Recording(tmp_path / "flight.mcap")
