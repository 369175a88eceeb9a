"""MAVLink FTP and the log protocol of the built-in autopilot, from messages to messages."""

from __future__ import annotations

import json
import struct
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.mavlink.component_files import FILES, GENERAL
from arena.autopilot.mavlink.file_server import FileServer, Operation, Problem
from arena.autopilot.mavlink.log_server import LogServer
from arena.autopilot.mavlink.vehicle_files import VehicleFiles
from arena.autopilot.stored_logs import LogEntry
from arena.builtin_parameters import SPECS
from arena.wire.px4_messages import px4_crc32

HEAD = struct.Struct("<HBBBBBBI")
LOG = bytes(range(256)) * 10
ACK, NAK = 128, 129


class Reading:
    """Content whose reading ends when the test says so."""

    def __init__(self, data: bytes | None) -> None:
        self._data, self.ready = data, False

    @property
    def data(self) -> bytes | None:
        return self._data if self.ready else None


class Library:
    """Two logs of uav1 and one of uav2."""

    def __init__(self) -> None:
        self.reading: list[Reading] = []
        self.lost = False

    def logs(self, vehicle: str) -> list[LogEntry]:
        found = {"uav1": [LogEntry("uav1.ulg", 100, 1.0), LogEntry("uav1_2.ulg", len(LOG), 60.0)]}
        return found.get(vehicle, [LogEntry("uav2.ulg", 5, 0.0)])

    def read(self, name: str) -> Reading:
        self.reading.append(Reading(None if self.lost else LOG))
        return self.reading[-1]


class Client:
    """Client of the FTP server with system id 255."""

    def __init__(self, server: FileServer, system: int = 255) -> None:
        self.server, self.system, self.seq, self.now = server, system, 10, 0.0

    def send(
        self, operation: int, data: bytes = b"", *, offset: int = 0, size: int | None = None
    ) -> list[Any]:
        self.seq += 2
        return self.repeat(operation, data, offset=offset, size=size)

    def repeat(
        self, operation: int, data: bytes = b"", *, offset: int = 0, size: int | None = None
    ) -> list[Any]:
        head = HEAD.pack(self.seq, 0, operation, len(data) if size is None else size, 0, 0, 0, offset)
        m = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, (head + data).ljust(251, b"\0"))
        m._header = mavlink.MAVLink_header(110, srcSystem=self.system, srcComponent=190)
        return [self.read(each) for each in self.server.receive("router", m, self.now)]

    def next(self) -> list[Any]:
        return [self.read(each) for each in self.server.next_messages("router")]

    def read(self, m: Any) -> Any:
        raw = bytes(m.payload)
        seq, _, operation, size, asked, _, _, offset = HEAD.unpack_from(raw)
        data = raw[HEAD.size : HEAD.size + size]
        assert (m.target_system, m.target_component) == (self.system, 190)
        return SimpleNamespace(seq=seq, operation=operation, asked=asked, offset=offset, data=data)

    def refused(self, operation: int, data: bytes = b"", **more: int) -> int:
        (reply,) = self.send(operation, data, **more)
        assert reply.operation == NAK
        return int(reply.data[0])


@pytest.fixture
def library() -> Library:
    return Library()


@pytest.fixture
def client(library: Library) -> Client:
    return Client(FileServer(VehicleFiles("uav1", library)))


def test_announced_file_is_read_whole_and_has_the_announced_checksum(client):
    uri, crc = GENERAL
    path = uri.removeprefix("mftp://").encode()
    (reply,) = client.send(Operation.OPEN_FILE_RO, path)
    (size,) = struct.unpack("<I", reply.data)
    assert reply.operation == ACK and reply.seq == client.seq + 1
    content = b""
    while len(content) < size:
        (reply,) = client.send(Operation.READ_FILE, offset=len(content), size=50)
        content += reply.data
    assert px4_crc32(content) == crc
    named = json.loads(content)["metadataTypes"]
    assert [file["type"] for file in named] == [1, 4]  # parameters, events
    for file in named:
        assert px4_crc32(FILES["/" + file["uri"].removeprefix("mftp://")]) == file["fileCrc"]
    assert client.refused(Operation.READ_FILE, offset=size, size=10) == Problem.END_OF_FILE


def test_described_parameters_are_those_of_the_autopilot():
    described = {p["name"]: p for p in json.loads(FILES["/etc/extras/parameters.json"])["parameters"]}
    assert described.keys() == SPECS.keys()
    for name, spec in SPECS.items():
        assert described[name]["default"] == spec.default
        assert described[name]["type"] == ("Int32" if spec.type == "int32" else "Float")


def test_file_is_sent_as_a_burst_that_ends_with_end_of_file(client, library):
    assert client.send(Operation.OPEN_FILE_RO, b"/log/uav1_2.ulg") == []
    assert client.server.busy and client.next() == []
    library.reading[0].ready = True
    (reply,) = client.next()
    assert reply.data == struct.pack("<I", len(LOG))
    assert client.send(Operation.BURST_READ_FILE, offset=300, size=239) == []
    parts = []
    while client.server.busy:
        found = client.next()
        assert 0 < len(found) <= 4
        parts += found
    assert b"".join(p.data for p in parts[:-1]) == LOG[300:]
    assert [p.seq for p in parts] == list(range(client.seq + 1, client.seq + 1 + len(parts)))
    assert (parts[-1].operation, parts[-1].data[0]) == (NAK, Problem.END_OF_FILE)


def test_folders_are_listed_with_sizes_and_an_offset(client):
    (root,) = client.send(Operation.LIST_DIRECTORY, b"/")
    assert root.data == b"Detc\0Dlog\0"
    (logs,) = client.send(Operation.LIST_DIRECTORY, b"log/")
    assert logs.data == f"Fuav1.ulg\t100\0Fuav1_2.ulg\t{len(LOG)}\0".encode()
    (rest,) = client.send(Operation.LIST_DIRECTORY, b"/log", offset=1)
    assert rest.data == f"Fuav1_2.ulg\t{len(LOG)}\0".encode()
    assert client.refused(Operation.LIST_DIRECTORY, b"/log", offset=2) == Problem.END_OF_FILE


@pytest.mark.parametrize(
    "path", [b"/no", b"@PARAM/param.pck", b"/log/uav2.ulg", b"/log/../log/uav1.ulg", b"/log", b""]
)
def test_file_that_is_not_offered_is_not_found(client, library, path):
    assert client.refused(Operation.OPEN_FILE_RO, path) == Problem.FILE_NOT_FOUND
    assert not library.reading


@pytest.mark.parametrize("operation", [6, 7, 8, 9, 10, 11, 12, 13])
def test_nothing_can_be_written_or_removed(client, operation):
    assert client.refused(operation, b"/log/uav1.ulg") == Problem.FILE_PROTECTED


def test_unknown_or_impossible_requests_are_refused(client):
    assert client.refused(77) == Problem.UNKNOWN_COMMAND
    assert client.refused(Operation.READ_FILE, size=10) == Problem.INVALID_SESSION
    assert client.refused(Operation.TERMINATE_SESSION) == Problem.INVALID_SESSION
    assert client.refused(Operation.LIST_DIRECTORY, b"/", size=250) == Problem.INVALID_DATA_SIZE


def test_repeated_request_gets_the_reply_again_and_opens_no_second_file(client):
    path = GENERAL[0].removeprefix("mftp://").encode()
    (first,) = client.send(Operation.OPEN_FILE_RO, path)
    (again,) = client.repeat(Operation.OPEN_FILE_RO, path)
    assert vars(again) == vars(first)
    assert client.refused(Operation.OPEN_FILE_RO, path) == Problem.NO_SESSIONS_AVAILABLE


def test_log_that_the_disk_does_not_give_is_refused(client, library):
    library.lost = True
    assert client.send(Operation.OPEN_FILE_RO, b"/log/uav1.ulg") == []
    library.reading[0].ready = True
    (reply,) = client.next()
    assert (reply.operation, reply.data[0]) == (NAK, Problem.FAIL) and not client.server.busy


def test_clients_have_sessions_of_their_own_and_silent_ones_end(client):
    path = GENERAL[0].removeprefix("mftp://").encode()
    others = [Client(client.server, system) for system in range(1, 8)]
    for each in (client, *others):
        assert each.send(Operation.OPEN_FILE_RO, path)[0].operation == ACK
    late = Client(client.server, 99)
    assert late.refused(Operation.OPEN_FILE_RO, path) == Problem.NO_SESSIONS_AVAILABLE
    late.now = 10.1
    assert late.send(Operation.OPEN_FILE_RO, path)[0].operation == ACK


def test_session_that_waits_for_the_disk_or_sends_a_burst_is_not_silent(client, library):
    assert client.send(Operation.OPEN_FILE_RO, b"/log/uav1.ulg") == []
    other = Client(client.server, 99)
    other.now = 10.1
    assert other.send(Operation.LIST_DIRECTORY, b"/")
    library.reading[0].ready = True
    (reply,) = client.next()
    assert reply.operation == ACK
    client.send(Operation.BURST_READ_FILE, size=239)
    other.now = 30.0
    assert other.send(Operation.LIST_DIRECTORY, b"/")
    assert client.server.busy, "the burst goes on"


# -- log protocol ------------------------------------------------------------------------------------------------------


@pytest.fixture
def logs(library: Library) -> LogServer:
    return LogServer(VehicleFiles("uav1", library), 1000.0)


def sent(server: LogServer) -> list[Any]:
    found: list[Any] = []
    while server.busy:
        now = server.next_messages("router")
        assert 0 < len(now) <= 10
        found += now
    return found


def test_logs_are_listed_with_number_size_and_date(logs):
    logs.receive("router", mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    assert logs.next_messages("vision") == []
    first, second = sent(logs)
    assert (first.id, first.num_logs, first.last_log_num, first.size, first.time_utc) == (0, 2, 1, 100, 1001)
    assert (second.id, second.size, second.time_utc) == (1, len(LOG), 1060)


def test_list_of_a_vehicle_without_logs_is_one_empty_entry():
    server = LogServer(VehicleFiles("uav1", None), 0.0)
    server.receive("router", mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    (entry,) = sent(server)
    assert (entry.num_logs, entry.size) == (0, 0)


@pytest.mark.parametrize(("at", "count"), [(0, 400), (90, 90), (len(LOG) - 30, 90), (0, 0xFFFFFFFF)])
def test_requested_part_of_a_log_is_sent(logs, library, at, count):
    logs.receive("router", mavlink.MAVLink_log_request_data_message(1, 1, 1, at, count))
    assert logs.next_messages("router") == []  # the disk has not replied yet
    library.reading[0].ready = True
    parts = sent(logs)
    assert b"".join(bytes(p.data[: p.count]) for p in parts) == LOG[at : at + count]
    assert parts[0].ofs == at and all(p.id == 1 for p in parts)


def test_download_ends_on_request_and_unknown_logs_are_ignored(logs, library):
    logs.receive("router", mavlink.MAVLink_log_request_data_message(1, 1, 5, 0, 90))
    assert not logs.busy
    logs.receive("router", mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 0xFFFFFFFF))
    library.reading[0].ready = True
    assert len(logs.next_messages("router")) == 10
    logs.receive("router", mavlink.MAVLink_log_request_end_message(1, 1))
    assert not logs.busy


def test_logs_are_not_erased(logs):
    logs.receive("router", mavlink.MAVLink_log_erase_message(1, 1))
    logs.receive("router", mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    assert len(sent(logs)) == 2
