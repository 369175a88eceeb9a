"""The access check in front of the real server: HTTP and WebSocket, with and without the token."""

from __future__ import annotations

import dataclasses
import http.client
import os

import pytest

from arena.errors import RunError
from arena.monitor.access import Access
from arena.monitor.server import free_port, open_server

pytest.importorskip("viser")
websockets = pytest.importorskip("websockets.sync.client")
InvalidStatus = pytest.importorskip("websockets.exceptions").InvalidStatus

TOKEN = "a-token-of-a-test"


@pytest.fixture(scope="module")
def access():
    made = Access(host="127.0.0.1", port=free_port("127.0.0.1", 0), token=TOKEN)
    server = open_server(made)
    yield made
    server.stop()


def get(access, path, **headers):
    connection = http.client.HTTPConnection(access.host, access.port, timeout=20)
    connection.request("GET", path, headers=headers)
    reply = connection.getresponse()
    body = reply.read()
    connection.close()
    return reply, body


def connect(access, **headers):
    import viser

    url = f"ws://{access.host}:{access.port}/"
    return websockets.connect(
        url,
        origin=f"http://{access.host}:{access.port}",
        subprotocols=[f"viser-v{viser.__version__}"],
        additional_headers=headers,
        open_timeout=20,
    )


def test_page_is_not_served_without_the_token(access):
    for path in ("/", "/index.html", "/?token=wrong"):
        reply, body = get(access, path)
        assert reply.status == 403 and b"<html" not in body


def test_websocket_without_the_token_gets_no_message(access):
    with pytest.raises(InvalidStatus) as refused:
        connect(access)
    assert refused.value.response.status_code == 403


def test_url_with_the_token_opens_page_and_websocket(access):
    reply, _ = get(access, f"/?token={TOKEN}")
    assert (reply.status, reply.headers["Location"]) == (302, "/")
    cookie = reply.headers["Set-Cookie"].partition(";")[0]
    reply, body = get(access, "/", Cookie=cookie)
    assert reply.status == 200 and b"<html" in body
    with connect(access, Cookie=cookie) as connection:
        assert connection.recv(timeout=20)


def test_page_on_loopback_is_served_to_the_own_user_only():
    """The user of a real connection is found in the kernel's table."""
    mine = Access(host="127.0.0.1", port=free_port("127.0.0.1", 0), token="", uids=frozenset({os.getuid()}))
    for access, allowed in (
        (mine, True),
        (dataclasses.replace(mine, uids=frozenset({os.getuid() + 1})), False),
    ):
        server = open_server(dataclasses.replace(access, port=free_port("127.0.0.1", 0)))
        try:
            reached = dataclasses.replace(access, port=server.get_port())
            reply, body = get(reached, "/")
            assert (reply.status, b"<html" in body) == ((200, True) if allowed else (403, False))
            if allowed:
                with connect(reached) as connection:
                    assert connection.recv(timeout=20)
            else:
                with pytest.raises(InvalidStatus):
                    connect(reached)
        finally:
            server.stop()


def test_server_without_the_check_is_not_used(monkeypatch):
    import viser

    class Unchecked(viser.ViserServer):
        def __init__(self, **_):
            self.stopped = False

        def get_port(self):
            return 1

        def stop(self):
            self.stopped = True

    monkeypatch.setattr(viser, "ViserServer", Unchecked)
    with pytest.raises(RunError, match="access check is not in place"):
        open_server(Access(host="127.0.0.1", port=1, token=""))
