"""MAVLink FTP server of one vehicle: lists and reads files. No file can be written or removed.

Input and output are messages. Requests and replies are those of PX4 v1.16, with one difference: every client has a session of
its own, so that a ground station and an SDK can read at the same time.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Protocol

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.stored_logs import Content
from arena.wire.px4_messages import px4_crc32

MESSAGE_IDS = (mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,)
_HEAD = struct.Struct(
    "<HBBBBBBI"
)  # sequence, session, operation, size, requested operation, burst complete, -, offset
_MOST_DATA = 239
_MESSAGES_PER_STEP = 4  # a datagram stays below 2048 bytes, which SDKs can receive
_MOST_SESSIONS = 8
_SESSION_TIMEOUT_S = 10.0
_ACK, _NAK = 128, 129
_Client = tuple[str, int, int]  # link, system, component


class Operation(IntEnum):
    """Operations of MAVLink FTP that a client can request."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15


class Problem(IntEnum):
    """Error codes of MAVLink FTP in the reply to a refused request."""

    FAIL = 1
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class Files(Protocol):
    """Interface through which the file server lists and reads the files of one vehicle.

    No method waits for a disk. Paths begin with `/`.
    """

    def entries(self, folder: str) -> list[tuple[str, int | None]] | None:
        """Return (name, size [bytes]) of each file and subfolder in a folder; the size of a subfolder is None.

        Return None if the folder does not exist.
        """
        ...

    def read(self, path: str) -> Content | None:
        """Start to read a file for a client. Return its `Content`; None if the file does not exist."""
        ...


@dataclass(frozen=True, slots=True)
class _Header:
    seq: int
    session: int
    operation: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        """Path in the data of an FTP request, in the form `/folder/file`.

        A path with `..` names no file.
        """
        text = self.data.split(b"\0", 1)[0].decode(errors="replace")
        return "/" + "/".join(part for part in text.split("/") if part not in ("", "."))


@dataclass(slots=True)
class _Session:
    """MAVLink FTP session of one client: its open file and the state of its download.

    data: content of the open file, None if no file is open
    loading: file that is being read, None if there is none
    waiting: request whose reply waits for this file
    stream_at: position of a burst in the file, -1 if no burst is in progress
    last: sequence number and message of the last short reply, which is sent again if the client repeats its request
    """

    data: bytes | None = None
    loading: Content | None = None
    waiting: _Header | None = None
    stream_at: int = -1
    stream_seq: int = 0
    used_at: float = 0.0
    last: tuple[int, Any] | None = None

    @property
    def has_output(self) -> bool:
        """True while a reply waits for the disk, or a burst is in progress."""
        return self.waiting is not None or self.stream_at >= 0


class _Refused(Exception):
    """Exception: the FTP server refuses a request. problem: error code of the reply."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.name)
        self.problem = problem


class _Later(Exception):
    """Exception: the reply to an FTP request must wait until a background thread has read the file."""


@dataclass(slots=True)
class FileServer:
    """MAVLink FTP server of one vehicle.

    Call `receive` for each message, and `next_messages` in each step while `busy`.
    """

    files: Files
    _sessions: dict[_Client, _Session] = field(default_factory=dict)

    @property
    def busy(self) -> bool:
        """True while a file is being read or sent."""
        return any(s.has_output for s in self._sessions.values())

    def receive(self, link: str, m: Any, now: float) -> list[Any]:
        """Process a FILE_TRANSFER_PROTOCOL message to this vehicle. Return the replies for the same link.

        now: time since boot [s]
        """
        client = link, m.get_srcSystem(), m.get_srcComponent()
        raw = bytes(m.payload)
        seq, session, operation, size, _, _, _, offset = _HEAD.unpack_from(raw)
        h = _Header(
            seq, session, operation, size, offset, raw[_HEAD.size : _HEAD.size + min(size, _MOST_DATA)]
        )
        s = self._session(client, now)
        if s is None:
            return [_reply(client, h, _NAK, bytes([Problem.NO_SESSIONS_AVAILABLE]))]
        if s.last is not None and s.last[0] == (seq + 1) & 0xFFFF:
            return [s.last[1]]
        if s.waiting is not None:  # the client repeats a request whose file is being read, or has given it up
            if s.waiting.seq == seq:
                return []
            s.waiting = s.loading = None
        s.last = None
        return self._answer(client, s, h)

    def next_messages(self, link: str) -> list[Any]:
        """Return the FTP messages to send on this link: replies that waited for a file, and parts of burst downloads."""
        out: list[Any] = []
        for client, s in self._sessions.items():
            if client[0] != link:
                continue
            if s.waiting is not None and s.loading is not None and s.loading.ready:
                h, s.waiting = s.waiting, None
                out += self._answer(client, s, h)
            while s.stream_at >= 0 and len(out) < _MESSAGES_PER_STEP:
                out.append(_burst(client, s))
        return out

    def _session(self, client: _Client, now: float) -> _Session | None:
        """Return the session of a client; None if too many clients have a session.

        Sessions without a request for 10 s are removed, except those that still have data to send.
        """
        for other, s in list(self._sessions.items()):
            if other != client and not s.has_output and now - s.used_at > _SESSION_TIMEOUT_S:
                del self._sessions[other]
        if client not in self._sessions and len(self._sessions) >= _MOST_SESSIONS:
            return None
        s = self._sessions.setdefault(client, _Session())
        s.used_at = now
        return s

    def _answer(self, client: _Client, s: _Session, h: _Header) -> list[Any]:
        try:
            if h.size > _MOST_DATA:
                raise _Refused(Problem.INVALID_DATA_SIZE)
            data = self._run(s, h)
        except _Later:
            s.waiting = h
            return []
        except _Refused as refused:
            return [self._kept(s, h, _reply(client, h, _NAK, bytes([refused.problem])), 1)]
        if data is None:
            return []
        return [self._kept(s, h, _reply(client, h, _ACK, data), len(data))]

    def _kept(self, s: _Session, h: _Header, reply: Any, size: int) -> Any:
        """Store a short FTP reply, so that it can be sent again if the client repeats its request.

        A longer reply is computed again, as in PX4.
        """
        if size <= 4:
            s.last = (h.seq + 1) & 0xFFFF, reply
        return reply

    def _run(self, s: _Session, h: _Header) -> bytes | None:
        """Execute an FTP request. Return the data of the reply; None if the reply is a burst of messages."""
        handler = _OPERATIONS.get(h.operation)
        if handler is None:
            known = h.operation in Operation.__members__.values()
            raise _Refused(Problem.FILE_PROTECTED if known else Problem.UNKNOWN_COMMAND)
        return handler(self, s, h)

    def _nothing(self, s: _Session, h: _Header) -> bytes:
        return b""

    def _terminate(self, s: _Session, h: _Header) -> bytes:
        if h.session != 0 or s.data is None:
            raise _Refused(Problem.INVALID_SESSION)
        return self._reset(s, h)

    def _reset(self, s: _Session, h: _Header) -> bytes:
        s.data, s.loading, s.waiting, s.stream_at = None, None, None, -1
        return b""

    def _list(self, s: _Session, h: _Header) -> bytes:
        entries = self.files.entries(h.path)
        if entries is None:
            raise _Refused(Problem.FILE_NOT_FOUND)
        found = b""
        for name, size in entries[h.offset :]:
            entry = f"D{name}\0" if size is None else f"F{name}\t{size}\0"
            if len(found) + len(entry.encode()) > _MOST_DATA:
                break
            found += entry.encode()
        if not found:
            raise _Refused(Problem.END_OF_FILE)
        return found

    def _open(self, s: _Session, h: _Header) -> bytes:
        if s.data is not None:
            raise _Refused(Problem.NO_SESSIONS_AVAILABLE)
        s.data = self._load(s, h)
        return struct.pack("<I", len(s.data))

    def _crc(self, s: _Session, h: _Header) -> bytes:
        return struct.pack("<I", px4_crc32(self._load(s, h)))

    def _load(self, s: _Session, h: _Header) -> bytes:
        """Return the content of the file that an FTP request names.

        Raises _Later while the file is being read.
        """
        content, s.loading = s.loading or self.files.read(h.path), None
        if content is None:
            raise _Refused(Problem.FILE_NOT_FOUND)
        if not content.ready:
            s.loading = content
            raise _Later
        if content.data is None:
            raise _Refused(Problem.FAIL)
        return content.data

    def _read(self, s: _Session, h: _Header) -> bytes:
        data = self._opened(s, h)
        if h.offset >= len(data):
            raise _Refused(Problem.END_OF_FILE)
        return data[h.offset : h.offset + min(h.size, _MOST_DATA)]

    def _start_burst(self, s: _Session, h: _Header) -> None:
        self._opened(s, h)
        s.stream_at, s.stream_seq = h.offset, (h.seq + 1) & 0xFFFF

    def _opened(self, s: _Session, h: _Header) -> bytes:
        if h.session != 0 or s.data is None:
            raise _Refused(Problem.INVALID_SESSION)
        return s.data


def _burst(client: _Client, s: _Session) -> Any:
    """Return the next message of a burst download.

    It contains a part of the file, or END_OF_FILE, which ends the burst.
    """
    part = s.data[s.stream_at : s.stream_at + _MOST_DATA] if s.data is not None else b""
    h = _Header((s.stream_seq - 1) & 0xFFFF, 0, Operation.BURST_READ_FILE, 0, s.stream_at, b"")
    s.stream_seq = (s.stream_seq + 1) & 0xFFFF
    if not part:
        s.stream_at = -1
        return _reply(client, h, _NAK, bytes([Problem.END_OF_FILE]))
    s.stream_at += len(part)
    return _reply(client, h, _ACK, part)


def _reply(client: _Client, h: _Header, operation: int, data: bytes) -> Any:
    seq = (h.seq + 1) & 0xFFFF
    head = _HEAD.pack(seq, h.session, operation, len(data), h.operation, 0, 0, h.offset)
    return mavlink.MAVLink_file_transfer_protocol_message(
        0, client[1], client[2], (head + data).ljust(_HEAD.size + _MOST_DATA, b"\0")
    )


_OPERATIONS: dict[int, Callable[[FileServer, _Session, _Header], bytes | None]] = {
    Operation.NONE: FileServer._nothing,
    Operation.TERMINATE_SESSION: FileServer._terminate,
    Operation.RESET_SESSIONS: FileServer._reset,
    Operation.LIST_DIRECTORY: FileServer._list,
    Operation.OPEN_FILE_RO: FileServer._open,
    Operation.READ_FILE: FileServer._read,
    Operation.BURST_READ_FILE: FileServer._start_burst,
    Operation.CALC_FILE_CRC32: FileServer._crc,
}
