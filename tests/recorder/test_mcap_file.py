"""File of the record: what a killed writer, a full disk and a disk that does not respond leave."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from record_files import RecordFile

from arena.flight_log.recording import Recording
from arena.recorder import mcap_file

TESTS = Path(__file__).parents[1]


def wait_for(condition: Callable[[], bool], deadline_s: float = 60.0) -> None:
    end = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.001)


def datagrams(path: Path) -> list[bytes]:
    return [d.data for d in Recording(path).datagrams("uav1")]


def log(record: RecordFile, number: int) -> None:
    record.channels.on_datagrams([("uav1", False, b"%d" % number * 100, float(number))])
    record.file.flush()


def test_killed_writer_loses_nothing_that_was_flushed(tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS.parent), *sys.path])}
    argv = [sys.executable, str(TESTS / "children" / "record_writer.py"), str(tmp_path)]
    with subprocess.Popen(argv, stdout=subprocess.PIPE, env=environment) as writer:
        assert writer.stdout is not None
        lines = [writer.stdout.readline() for _ in range(5)]
        writer.kill()
    written = int(lines[-1])
    found = datagrams(tmp_path / "flight.mcap")
    assert written == 500 and len(found) >= written
    assert [int.from_bytes(data, "big") for data in found] == list(range(len(found)))


def test_full_disk_ends_the_record_and_keeps_what_was_written(tmp_path, monkeypatch):
    record = RecordFile(tmp_path / "flight.mcap")
    for number in range(3):
        log(record, number)
    wait_for(lambda: not record.file.busy)

    def full(fd: int, data: bytes) -> None:
        os.write(fd, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(mcap_file, "write_all", full)
        log(record, 3)
        wait_for(lambda: bool(record.file.failure))
    assert record.file.failure == "No space left on device"
    log(record, 4)  # there is space again, but the file ends in the middle of a chunk
    assert not record.file.close()
    assert datagrams(tmp_path / "flight.mcap") == [b"%d" % n * 100 for n in range(3)]


def test_hung_disk_blocks_nothing_and_ends_the_record(tmp_path, monkeypatch):
    record = RecordFile(tmp_path / "flight.mcap", max_waiting_bytes=20_000)
    wait_for(lambda: not record.file.busy)
    entered, responds, ended = threading.Event(), threading.Event(), threading.Event()
    monkeypatch.setattr(os, "fdatasync", lambda fd: (entered.set(), responds.wait(120.0), ended.set()))
    log(record, 0)
    assert entered.wait(60.0)
    number = 1
    while not record.file.failure and number < 1000:
        log(record, number)
        number += 1
    assert "does not respond" in record.file.failure
    for more in range(1000):
        log(record, number + more)
    assert not record.file.close(timeout_s=0.1)
    assert not ended.is_set(), "the record waited for the disk"
    responds.set()
    wait_for(lambda: not record.file.busy)
    assert datagrams(tmp_path / "flight.mcap") == [b"0" * 100]


def test_slow_disk_loses_nothing(tmp_path, monkeypatch):
    slow = threading.Event()
    monkeypatch.setattr(os, "fdatasync", lambda fd: slow.wait(30.0))
    record = RecordFile(tmp_path / "flight.mcap")
    for number in range(50):
        log(record, number)
    slow.set()
    record.close()
    assert len(datagrams(tmp_path / "flight.mcap")) == 50


def test_folder_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        RecordFile(tmp_path / "file" / "flight.mcap")
