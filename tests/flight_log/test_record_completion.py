"""Completion of a record whose recorder was killed or restarted."""

from __future__ import annotations

import pytest
from mcap.reader import make_reader
from record_files import RecordFile, damage_second_chunk

from arena.errors import InputError
from arena.flight_log.record_completion import complete_record, is_complete
from arena.flight_log.recording import Recording


def record(path, numbers, close=True):
    made = RecordFile(path)
    for number in numbers:
        made.channels.on_datagrams([("uav1", number % 2 == 0, b"%d" % number, 0.1 * number)])
        made.channels.on_event(b'{"event": "x"}', {}, 0.1 * number)
        made.file.flush()
    made.close()


def test_complete_record_is_not_changed(tmp_path):
    path = tmp_path / "flight.mcap"
    record(path, range(5))
    before = path.read_bytes()
    assert is_complete(path)
    assert not complete_record(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("lost", [1, 200, 2000])
def test_record_of_a_killed_recorder_gets_an_index(tmp_path, lost):
    path = tmp_path / "flight.mcap"
    record(path, range(50))
    path.write_bytes(path.read_bytes()[:-lost])
    before, metadata = list(Recording(path).messages()), Recording(path)
    assert before
    assert not is_complete(path)
    assert complete_record(path)
    assert is_complete(path)
    after = Recording(path)
    assert list(after.messages()) == before
    assert (after.name, after.vehicles, after.start_unix_s) == (
        metadata.name,
        metadata.vehicles,
        metadata.start_unix_s,
    )
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == len(before)
    assert summary.statistics.metadata_count == 1


def test_parts_of_a_restarted_recorder_are_joined(tmp_path):
    path = tmp_path / "flight.mcap"
    for k in range(3):
        record(path, range(10 * k, 10 * k + 10))
    path.write_bytes(path.read_bytes()[:-500])  # the first recorder was killed
    before = list(Recording(path).messages())
    assert complete_record(path)
    assert [p.name for p in tmp_path.iterdir()] == ["flight.mcap"]
    assert list(Recording(path).messages()) == before
    assert len(before) > 40


def test_record_that_is_still_written_is_not_changed(tmp_path):
    path = tmp_path / "flight.mcap"
    record(path, range(5))
    path.write_bytes(path.read_bytes()[:-100])
    writing = RecordFile(path)
    before = path.read_bytes()
    assert not complete_record(path)
    assert path.read_bytes() == before
    writing.close()
    assert complete_record(path)


def test_missing_record_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        complete_record(tmp_path / "flight.mcap")


def test_data_after_a_damaged_chunk_are_kept(tmp_path):
    path = tmp_path / "flight.mcap"
    file = RecordFile(path)
    for number in range(5000):
        file.channels.on_datagrams([("uav1", False, b"datagram %d" % number, 0.001 * number)])
        if number % 500 == 499:
            file.end_chunk()
    file.close()
    damage_second_chunk(path, lost_bytes=100)
    before = list(Recording(path).messages())
    assert len(before) == 4500
    assert complete_record(path)
    assert len(list(Recording(path).messages())) == 4500
