"""The control socket of a running arena. Requests and replies are one JSON object per line.

    {"do": "ps"}                       -> {"name": ..., "processes": {...}, "facts": {...}, ...}
    {"do": "view"}                     -> the same; a viewer repeats this request, so it does not mean that an operator is present
    {"do": "restart", "name": "x", "yes": false}  -> {"ok": true}
    {"do": "arm_permit", "vehicles": ["uav1"], "by": "alice"}  -> {"ok": true}
    {"do": "preflight", "vehicle": "uav1", "by": "alice", "stop": false}  -> {"ok": true}
    {"do": "forget", "vehicle": "uav1", "by": "name"}  -> {"ok": true}
    {"do": "replay", "pause": true, "seek_s": 12.5, "speed": 2.0}  -> {"ok": true}; each of the three keys may be missing
    {"do": "down", "now": false}       -> {"ok": true}
    {"do": "subscribe"}                -> {"ok": true}, then {"say": "..."} for every line that the run shows, until its end
The reply to any other line is {"error": "..."}. The server never waits for a client: a client that does not read its
replies is disconnected.

Only the user who started the arena can open the socket and its folder. The server also gets the user of every
connection from the kernel, and refuses users other than the owner and root. If the folder is shared with a group
(ARENA_GROUP), the kernel allows the members of this group to open the socket, and the server accepts them too.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import socket
import struct
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from arena.errors import RunError
from arena.run_dirs import shared_group

_LONGEST_REQUEST = 1 << 16
_LONGEST_ANSWER = 1 << 22
_MOST_CLIENTS = 32

Answer = Callable[[dict[str, Any]], dict[str, Any]]


class _Client:
    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.received = b""
        self.unsent = b""
        self.subscribed = False


class ControlServer:
    """Server of the control socket. The main loop calls it when data arrive. No method blocks.

    path: path of the socket, in the private runtime folder of the run.
    answer: function that returns the reply to a request, or raises KeyError or ValueError with a text for the client.
    refused: called with a text when a user is refused for the first time.
    users: ids of the users that are allowed; None for the owner and root, and the group with which the folder is shared.
    """

    def __init__(
        self,
        path: Path,
        selector: selectors.BaseSelector,
        answer: Answer,
        *,
        refused: Callable[[str], None] = lambda _: None,
        users: Collection[int] | None = None,
    ) -> None:
        self._answer, self._selector, self._on_refused = answer, selector, refused
        self._users = {0, os.getuid()} if users is None else set(users)
        group = shared_group(path.parent) if users is None else None
        self._is_shared = group is not None
        self.refused: dict[int, int] = {}
        self._clients: dict[int, _Client] = {}
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        half = path.with_name("control.new")  # clients connect as soon as the path exists
        self._socket.bind(str(half))
        half.chmod(0o600)
        if group is not None:
            os.chown(half, -1, group)
            half.chmod(0o660)
        self._socket.listen(_MOST_CLIENTS)
        half.rename(path)
        self._socket.setblocking(False)
        selector.register(self._socket, selectors.EVENT_READ, self._accept)

    def say(self, text: str) -> None:
        """Send one line of output to every client that has subscribed to the run's output."""
        for client in list(self._clients.values()):
            if client.subscribed:
                self._send(client, {"say": text})

    def close(self) -> None:
        """Disconnect every client and close the socket."""
        for client in list(self._clients.values()):
            self._drop(client)
        self._selector.unregister(self._socket)
        self._socket.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._socket.accept()
        except OSError:
            return
        connection.setblocking(False)
        if (user := _user(connection)) not in self._users and not self._is_shared:
            self._refuse(connection, user)
            return
        if len(self._clients) >= _MOST_CLIENTS:
            connection.close()
            return
        client = self._clients[connection.fileno()] = _Client(connection)
        self._selector.register(connection, selectors.EVENT_READ, lambda: self._serve(client))

    def _refuse(self, connection: socket.socket, user: int) -> None:
        with contextlib.suppress(OSError):
            connection.send(
                json.dumps({"error": f"user {user} is not allowed to command this arena"}).encode() + b"\n"
            )
        connection.close()
        self.refused[user] = self.refused.get(user, 0) + 1
        if self.refused[user] == 1:
            self._on_refused(
                f"refused a connection of user {user}: only the owner and root may command this arena"
            )

    def _serve(self, client: _Client) -> None:
        self._flush(client)
        try:
            data = client.connection.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        *lines, client.received = (client.received + data).split(b"\n")
        for line in lines:
            self._send(client, self._reply(client, line))
        if len(client.received) > _LONGEST_REQUEST:
            self._send(
                client, {"error": f"request too long: expected one line of at most {_LONGEST_REQUEST} bytes"}
            )
            self._drop(client)

    def _reply(self, client: _Client, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line)
            if not isinstance(request, dict):
                raise ValueError("expected a JSON object as the request")
            if request.get("do") == "subscribe":
                client.subscribed = True
                return {"ok": True}
            return self._answer(request)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            return {"error": str(error.args[0]) if error.args else type(error).__name__}

    def _send(self, client: _Client, packet: dict[str, Any]) -> None:
        client.unsent += json.dumps(packet, default=str).encode() + b"\n"
        self._flush(client)

    def _flush(self, client: _Client) -> None:
        if client.connection.fileno() < 0:
            return
        try:
            while client.unsent:
                client.unsent = client.unsent[client.connection.send(client.unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self._drop(client)
            return
        if len(client.unsent) > _LONGEST_ANSWER:
            self._drop(client)
            return
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.unsent else 0)
        key = self._selector.get_key(client.connection)
        if key.events != events:
            self._selector.modify(client.connection, events, key.data)

    def _drop(self, client: _Client) -> None:
        if client.connection.fileno() < 0:
            return
        self._clients.pop(client.connection.fileno(), None)
        with contextlib.suppress(KeyError):
            self._selector.unregister(client.connection)
        client.connection.close()


def _user(connection: socket.socket) -> int:
    """Return the user id of the connected process. The kernel reports it (SO_PEERCRED)."""
    _, user, _ = struct.unpack("iII", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return int(user)


class Control:
    """Client of an arena's control socket, for commands such as `arena ps`.

    path: path of the socket.
    timeout_s: longest wait for each reply [s].
    Raises RunError if no arena replies.
    """

    def __init__(self, path: Path, timeout_s: float = 5.0) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(timeout_s)
        self._received = b""
        self._kept: list[dict[str, Any]] = []
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            raise RunError(
                f"no arena replies at {path} ({error.strerror or error}): has the run ended?"
            ) from error

    def ask(self, **request: Any) -> dict[str, Any]:
        """Send one request and return the reply. Raises RunError without a reply or for an error reply.

        Lines of a subscription that arrive before the reply are kept; `listen` returns them later.
        """
        kept: list[dict[str, Any]] = []
        try:
            self._socket.sendall(json.dumps(request).encode() + b"\n")
            while (answer := self.listen()) is not None and "say" in answer:
                kept.append(answer)
            self._kept += kept
        except OSError as error:
            raise RunError(
                f"the arena did not reply ({error}): is its supervisor paused by SIGSTOP?"
            ) from error
        if answer is None:
            raise RunError("the arena ended before it replied to the request")
        if "error" in answer:
            raise RunError(str(answer["error"]))
        return answer

    def listen(self, timeout_s: float | None = None) -> dict[str, Any] | None:
        """Return the next packet, or None at the end of the run. Raises TimeoutError after `timeout_s` [s]."""
        if self._kept:
            return self._kept.pop(0)
        if timeout_s is not None:
            self._socket.settimeout(timeout_s)
        while b"\n" not in self._received:
            try:
                data = self._socket.recv(1 << 16)
            except ConnectionError:
                data = b""
            if not data:
                return None
            self._received += data
        line, _, self._received = self._received.partition(b"\n")
        packet = json.loads(line)
        return packet if isinstance(packet, dict) else {}

    def close(self) -> None:
        """Close the connection to the control socket."""
        self._socket.close()
