"""Message records of MCAP files, packed by the compiled and by the interpreted kernel, and read by the package `mcap`."""

from __future__ import annotations

import contextlib
import io
from types import ModuleType

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import McapRecord, Message, MessageIndex
from mcap.stream_reader import StreamReader

from arena.recorder.mcap_records import Definitions, IndexedFile, file_head, plain_chunk
from arena.wire.flight_record import DATAGRAM, EVENT
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAME = "mcap_messages"
VERSIONS = [
    pytest.param(interpreted_modules(NAME)[NAME], id="interpreted"),
    pytest.param(compiled_modules(NAME)[NAME], id="compiled", marks=needs_compiled),
]
SENT = [
    (1, b"first", 4_000_000),
    (3, b"", 0),
    (1, bytes(70_000), 1_764_221_234_123_456_789),
    (3, b"third", 5),
]


def read(data: bytes, *, skip_magic: bool = True) -> list[McapRecord]:
    """Return the records in a part of a file."""
    found: list[McapRecord] = []
    with contextlib.suppress(EndOfFile):
        found.extend(StreamReader(io.BytesIO(data), skip_magic=skip_magic, validate_crcs=True).records)
    return found


class Log:
    """Channels 1 to 3 of a file, of which channel 2 has no message."""

    def __init__(self, kernel: ModuleType) -> None:
        self.definitions = Definitions()
        self.buffer = kernel.MessageBuffer(self.definitions.define)
        schemas = {"/down": DATAGRAM, "/unused": EVENT, "/up": DATAGRAM}
        numbers = [self.definitions.add(topic, "bytes", schema) for topic, schema in schemas.items()]
        self.channels = [kernel.MessageChannel(self.buffer, number) for number in numbers]

    def send(self) -> None:
        for number, data, log_time in SENT:
            self.channels[number - 1].log(data, log_time)


@pytest.mark.parametrize("kernel", VERSIONS)
def test_messages_are_read_by_another_implementation(kernel: ModuleType) -> None:
    log = Log(kernel)
    file = IndexedFile(log.definitions)
    data = file.begin("arena", {"name": "lab", "height": "3 m"})
    for _ in range(2):
        log.send()
        data += file.chunk(*log.buffer.take())
    data += file.end(log.channels)
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None and summary.statistics is not None
    assert {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()} == {
        "/down": "mavlink.Datagram",
        "/up": "mavlink.Datagram",
    }
    assert summary.statistics.channel_message_counts == {1: 4, 3: 4}
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (0, SENT[2][2])
    found = [(m.channel_id, m.data, m.log_time) for _, _, m in reader.iter_messages(log_time_order=False)]
    assert found == SENT * 2
    assert [(m.name, m.metadata) for m in reader.iter_metadata()] == [
        ("arena", {"name": "lab", "height": "3 m"})
    ]


@pytest.mark.parametrize("kernel", VERSIONS)
def test_index_contains_the_place_of_each_message(kernel: ModuleType) -> None:
    log = Log(kernel)
    log.send()
    records, first, last = log.buffer.take()
    assert (first, last) == (0, SENT[2][2])
    index = kernel.message_index(records, 3)
    assert index[1] == b""
    for number in (1, 3):
        head = number.to_bytes(2, "little") + len(index[number - 1]).to_bytes(4, "little")
        record = b"\x07" + (6 + len(index[number - 1])).to_bytes(8, "little") + head + index[number - 1]
        (entries,) = read(record)
        assert isinstance(entries, MessageIndex) and entries.channel_id == number
        for log_time, at in entries.records:
            message = read(records[at:])[0]
            assert isinstance(message, Message)
            assert (number, message.data, message.log_time) in SENT and message.log_time == log_time


@pytest.mark.parametrize("kernel", VERSIONS)
def test_channel_is_defined_once_and_before_its_first_message(kernel: ModuleType) -> None:
    log = Log(kernel)
    log.send()
    first = log.buffer.take()[0]
    log.send()
    second = log.buffer.take()[0]
    kinds = [type(r).__name__ for r in read(first)]
    assert kinds == ["Schema", "Channel", "Message", "Channel", "Message", "Message", "Message"]
    kinds = [type(r).__name__ for r in read(second)]
    assert kinds == ["Message"] * 4
    data = file_head() + plain_chunk(first, 0, 1)
    assert len(read(data, skip_magic=False)) == 1 + 7


@pytest.mark.parametrize("kernel", VERSIONS)
def test_stopped_buffer_ignores_messages(kernel: ModuleType) -> None:
    log = Log(kernel)
    log.send()
    log.buffer.stop()
    log.send()
    assert log.buffer.take()[0] == b""


@pytest.mark.parametrize("kernel", VERSIONS)
def test_both_kernels_pack_the_same_bytes(kernel: ModuleType) -> None:
    log, other = Log(kernel), Log(interpreted_modules(NAME)[NAME])
    log.send()
    other.send()
    assert log.buffer.take() == other.buffer.take()
