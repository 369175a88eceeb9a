"""Lines that are appended to events.jsonl."""

from __future__ import annotations

import time

from arena.recorder.event_tail import EventTail


def read(tail: EventTail) -> list[bytes]:
    """Return the lines that a complete read finds."""
    tail.poll()
    end = time.monotonic() + 60.0
    while tail.busy:
        assert time.monotonic() < end
        time.sleep(0.001)
    return tail.take()


def test_lines_are_returned_once_and_only_when_they_are_complete(tmp_path):
    path = tmp_path / "events.jsonl"
    tail = EventTail(path)
    assert read(tail) == [], "the file does not exist yet"
    with path.open("ab", buffering=0) as file:
        file.write(b'{"a": 1}\n{"b"')
        assert read(tail) == [b'{"a": 1}']
        file.write(b': 2}\n\n{"c": 3}\n')
        assert read(tail) == [b'{"b": 2}', b'{"c": 3}']
        assert read(tail) == []
        file.write(b'{"last": 4}\n')
    assert tail.close() == [b'{"last": 4}']


def test_long_file_is_read_in_pieces(tmp_path):
    path = tmp_path / "events.jsonl"
    lines = [b"%06d" % i + b"x" * 1000 for i in range(3000)]
    path.write_bytes(b"\n".join(lines) + b"\n")
    tail, found = EventTail(path), []
    for _ in range(4):
        found += read(tail)
    assert found == lines
