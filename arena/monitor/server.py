"""The viser server of the live page, with an access check for every request.

viser serves the page and the WebSocket on one port with the library websockets, which calls `process_request` before it reads or
sends anything else. This module puts the check there.
"""

from __future__ import annotations

import contextlib
import http
import io
import socket
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from arena.errors import RunError
from arena.monitor.access import Access
from arena.monitor.peer import peer_uid

if TYPE_CHECKING:
    import viser

_MAX_PORTS = 20


def free_port(host: str, port: int) -> int:
    """Return the first free TCP port of `host`, starting at `port`.

    Raises RunError if no port is free near this number.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for candidate in range(port, port + _MAX_PORTS) if port else (0,):
        with contextlib.closing(socket.socket(family, socket.SOCK_STREAM)) as sock:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                sock.bind((host, candidate))
            except OSError as error:
                reason = error.strerror
                continue
            return int(sock.getsockname()[1])
    raise RunError(
        f"no port for the page is free on {host} from {port} to {port + _MAX_PORTS - 1} ({reason}): give another --port"
    )


def open_server(access: Access) -> viser.ViserServer:
    """Start the viser server of the live page, with the access check, and return it.

    Raises RunError if the check is not in place, for example because another version of viser works differently.
    """
    import viser

    class LocalServer(viser.ViserServer):
        """Viser server without the function that publishes the page on the internet."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            return None

    checked = threading.Event()
    with _check_in_front(access, checked), contextlib.redirect_stdout(io.StringIO()):
        server = LocalServer(host=access.host, port=access.port, verbose=False)
    if not checked.is_set() or server.get_port() != access.port:
        server.stop()
        raise RunError(
            f"the page is not served, because its access check is not in place (viser {viser.__version__}): "
            "install the version of viser that pyproject.toml names"
        )
    return server


@contextlib.contextmanager
def _check_in_front(access: Access, checked: threading.Event) -> Iterator[None]:
    """Add the access check to each server of the library websockets that starts in the `with` block.

    checked: event that is set as soon as a server has the check.
    """
    import websockets.asyncio.server as library

    original = library.serve

    def serve(*arguments: Any, **options: Any) -> Any:
        options["process_request"] = _checked(access, options.get("process_request"))
        checked.set()
        return original(*arguments, **options)

    library.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        library.serve = original  # type: ignore[misc]


def _uid_of(connection: Any) -> int | None:
    """Return the user id of the program that has opened a connection to the page; None if unknown.

    connection: of the library websockets.
    """
    client, server = connection.remote_address, connection.local_address
    return None if client is None or server is None else peer_uid(client[:2], server[:2])


def _checked(access: Access, inner: Any) -> Any:
    """Return the request handler that applies the access check, and passes allowed requests to `inner`."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    def process_request(connection: Any, request: Any) -> Any:
        headers = {name.lower(): value for name, value in request.headers.raw_items()}
        decision = access.decide(request.path, headers, None if access.token else _uid_of(connection))
        if not decision.allowed:
            body = (decision.why + "\n").encode()
            head = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
            return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", head, body)
        if decision.cookie:
            head = Headers({"Location": "/", "Set-Cookie": decision.cookie, "Content-Length": "0"})
            return Response(http.HTTPStatus.FOUND, "Found", head, b"")
        return None if inner is None else inner(connection, request)

    return process_request
