"""Access control of the live page: allows or refuses each HTTP request. Pure.

The decision is made before the server reads anything else of the request.

- On a loopback address, only programs of the same user, and of root, may connect: other users of the computer must not press buttons.
  Requests for another host name, and WebSocket connections that another web page has opened, are refused, too: a page of the internet
  in the user's browser must not press buttons.
- On any other address, and if the option `--token` is given, a token is needed. The URL with the token sets a cookie, which the browser
  then sends.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

from arena.errors import InputError
from arena.monitor.peer import allowed_uids

TOKEN_BYTES = 18
_WRONG_USER = (
    "refused: only the user who has started this page may open it, because it has buttons that land and stop vehicles. "
    "For other users, containers and systems without /proc, start it with `arena monitor --token`"
)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision about an HTTP request: allowed or refused, with the text or the cookie for the client.

    allowed: whether the server answers the request. cookie: value of Set-Cookie in a redirection; "" for none.
    why: text for a refused client.
    """

    allowed: bool
    cookie: str = ""
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class Access:
    """Access rules of one server of the live page.

    host, port: address that the server binds. token: secret that a client must send; "" if none is needed.
    uids: user ids whose programs need no token.
    """

    host: str
    port: int
    token: str
    uids: frozenset[int] = frozenset()

    def decide(self, path: str, headers: Mapping[str, str], uid: int | None = None) -> Decision:
        """Decide whether an HTTP request is allowed. Return the decision, with the text or cookie for the client.

        path: path of the request with its query.  headers: names in lower case.  uid: user who has opened the connection; None: unknown.
        """
        if not self.token and uid not in self.uids:
            return Decision(allowed=False, why=_WRONG_USER)
        host = headers.get("host", "")
        if not self.token and not _is_local_name(host):
            return Decision(
                allowed=False, why=f"refused: this page has the address {self.host}, not {host!r}"
            )
        origin = headers.get("origin", "")
        if headers.get("upgrade", "").lower() == "websocket" and urlsplit(origin).netloc != host:
            return Decision(allowed=False, why="refused: the connection comes from another web page")
        if not self.token or self._is_token(_cookie(headers.get("cookie", ""), self.cookie_name)):
            return Decision(allowed=True)
        given = parse_qs(urlsplit(path).query).get("token", [""])[0]
        if self._is_token(given):
            return Decision(
                allowed=True, cookie=f"{self.cookie_name}={self.token}; HttpOnly; SameSite=Lax; Path=/"
            )
        return Decision(
            allowed=False, why="refused: open the URL with the token that `arena monitor` has printed"
        )

    @property
    def cookie_name(self) -> str:
        """Return the name of the page's cookie, which contains the port so that two pages have different names.

        Browsers send a cookie to all ports of a host.
        """
        return f"arena_monitor_{self.port}"

    @property
    def url(self) -> str:
        """Return the URL of the page, with the token if a token is needed."""
        host = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host
        shown = f"[{host}]" if ":" in host else host
        return f"http://{shown}:{self.port}/" + (f"?token={self.token}" if self.token else "")

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.token.encode())


def access_for(host: str, port: int, *, token: bool = False) -> Access:
    """Return the access rules of a page at this address.

    If other computers can reach the address, a random token is required.

    token: require a token on a loopback address, too.
    Raises InputError if `host` is not a numeric address.
    """
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError as error:
        raise InputError(
            f"--host: got {host}, expected a numeric address, such as 127.0.0.1 or 0.0.0.0"
        ) from error
    if loopback and not token:
        return Access(host=host, port=port, token="", uids=allowed_uids())
    return Access(host=host, port=port, token=secrets.token_urlsafe(TOKEN_BYTES))


def _is_local_name(host: str) -> bool:
    """Return whether an HTTP header Host names this computer: localhost or a loopback address."""
    name = urlsplit(f"//{host}").hostname or ""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _cookie(header: str, name: str) -> str:
    for part in header.split(";"):
        key, _, value = part.strip().partition("=")
        if key == name:
            return value
    return ""
