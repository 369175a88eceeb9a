"""The thread that writes terminal and files: order, bounds, and a destination that blocks."""

from __future__ import annotations

import os
import threading
import time
from functools import partial
from queue import SimpleQueue

from arena.background_writer import BackgroundWriter, within, write_all


def blocked(writer: BackgroundWriter) -> threading.Event:
    """Block the thread of the writer until the returned event is set."""
    go, begun = threading.Event(), threading.Event()
    writer.submit(lambda: (begun.set(), go.wait(60.0)))
    assert begun.wait(60.0)
    return go


def test_writes_are_carried_out_in_order():
    done: list[int] = []
    writer = BackgroundWriter("test", limit=100)
    for i in range(50):
        writer.submit(partial(done.append, i))
    assert writer.flush(60.0) and done == list(range(50)) and not writer.busy


def test_blocked_destination_blocks_no_caller():  # review fault 11
    writer, done = BackgroundWriter("test", limit=10), []
    go = blocked(writer)
    for i in range(25):
        writer.submit(partial(done.append, i))
    assert writer.busy and writer.blocked_s(time.monotonic() + 5.0) >= 5.0
    assert not writer.flush(0.0) and writer.take_lost() == 15 and writer.take_lost() == 0
    go.set()
    assert writer.flush(60.0) and done == list(range(15, 25))
    assert writer.blocked_s(time.monotonic()) == 0.0


def test_newer_write_replaces_a_waiting_one():
    writer, done = BackgroundWriter("test", limit=10), []
    go = blocked(writer)
    for i in range(5):
        writer.submit(partial(done.append, i), replaces="state")
    go.set()
    assert writer.flush(60.0) and done == [4] and writer.take_lost() == 0


def test_a_result_that_comes_in_time_is_returned():
    assert within(60.0, lambda: 7) == 7


def test_a_result_that_comes_too_late_is_discarded():
    go, discarded = threading.Event(), SimpleQueue()
    assert within(0.0, lambda: go.wait(60.0) and 7, discard=discarded.put) is None
    go.set()
    assert discarded.get(timeout=60.0) == 7


def test_a_forked_process_has_a_thread_of_its_own():
    writer, (reading, writing) = BackgroundWriter("test", limit=10), os.pipe()
    writer.submit(lambda: None)
    assert writer.flush(60.0)
    if (pid := os.fork()) == 0:
        writer.submit(partial(os.write, writing, b"from the child"))
        os._exit(not writer.flush(60.0))
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert os.read(reading, 100) == b"from the child"
    os.close(reading)
    os.close(writing)


def test_write_all_writes_more_than_a_pipe_holds():
    reading, writing = os.pipe()
    data, found = b"x" * 300_000, b""
    thread = threading.Thread(target=write_all, args=(writing, data))
    thread.start()
    while len(found) < len(data):
        found += os.read(reading, 65536)
    thread.join()
    os.close(reading)
    os.close(writing)
    assert found == data
