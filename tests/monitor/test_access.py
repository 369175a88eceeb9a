"""Access to the page: on loopback for programs of the same user, on other addresses with the token."""

from __future__ import annotations

import pytest

from arena.errors import InputError
from arena.monitor.access import Access, access_for
from arena.monitor.peer import allowed_uids

ME, OTHER = 1000, 1001
LOCAL = Access(host="127.0.0.1", port=8480, token="", uids=frozenset({ME, 0}))
REMOTE = Access(host="0.0.0.0", port=8480, token="secret")
UPGRADE = {"upgrade": "websocket", "connection": "Upgrade"}


@pytest.mark.parametrize("host", ["127.0.0.1:8480", "localhost:8480", "127.0.0.3", "[::1]:8480"])
def test_loopback_names_need_no_token(host):
    assert LOCAL.decide("/", {"host": host}, ME).allowed


@pytest.mark.parametrize("host", ["evil.example:8480", "", "127.0.0.1.evil.example", "10.0.0.5:8480"])
def test_other_names_are_refused_on_loopback(host):
    decision = LOCAL.decide("/", {"host": host}, ME)
    assert not decision.allowed and "refused" in decision.why


def test_websocket_of_another_page_is_refused():
    mine = {"host": "127.0.0.1:8480", **UPGRADE}
    assert LOCAL.decide("/", {**mine, "origin": "http://127.0.0.1:8480"}, ME).allowed
    for origin in ("https://evil.example", "http://127.0.0.1:9999", "null", ""):
        assert not LOCAL.decide("/", {**mine, "origin": origin}, ME).allowed
    assert not LOCAL.decide("/", mine, ME).allowed, "without an origin"


@pytest.mark.parametrize("path", ["/", "/assets/index.js", "/?token=", "/?token=Secret", "/?x=secret"])
def test_nothing_is_served_without_the_token(path):
    assert not REMOTE.decide(path, {"host": "10.0.0.5:8480"}).allowed


def test_websocket_needs_the_cookie_not_only_the_right_page():
    mine = {"host": "10.0.0.5:8480", "origin": "http://10.0.0.5:8480", **UPGRADE}
    assert not REMOTE.decide("/", mine).allowed
    assert not REMOTE.decide("/", {**mine, "cookie": "arena_monitor_8480=wrong"}).allowed
    assert not REMOTE.decide("/", {**mine, "cookie": "arena_monitor_8481=secret"}).allowed
    assert REMOTE.decide("/", {**mine, "cookie": "a=b; arena_monitor_8480=secret"}).allowed


def test_url_with_the_token_sets_a_cookie_that_scripts_cannot_read():
    decision = REMOTE.decide("/?token=secret", {"host": "10.0.0.5:8480"})
    assert decision.allowed
    assert decision.cookie.startswith("arena_monitor_8480=secret;")
    assert "HttpOnly" in decision.cookie and "SameSite" in decision.cookie


@pytest.mark.parametrize("uid", [OTHER, None])
def test_other_users_of_the_computer_are_refused(uid):
    mine = {"host": "127.0.0.1:8480", "origin": "http://127.0.0.1:8480", **UPGRADE}
    for headers in ({"host": "127.0.0.1:8480"}, mine):
        decision = LOCAL.decide("/", headers, uid)
        assert not decision.allowed and "--token" in decision.why
        assert LOCAL.decide("/", headers, ME).allowed and LOCAL.decide("/", headers, 0).allowed


def test_token_on_loopback_replaces_the_check_of_the_user():
    access = access_for("127.0.0.1", 8480, token=True)
    local = {"host": "127.0.0.1:8480"}
    assert not access.decide("/", local, ME).allowed
    assert access.decide(f"/?token={access.token}", local, OTHER).allowed


def test_user_who_became_root_by_sudo_is_allowed(monkeypatch):
    monkeypatch.setattr("os.getuid", lambda: 0)
    monkeypatch.setenv("SUDO_UID", "1000")
    assert allowed_uids() == {0, 1000}
    monkeypatch.setattr("os.getuid", lambda: 1001)
    assert allowed_uids() == {0, 1001}, "the variable counts only for root"


def test_only_loopback_addresses_get_no_token():
    assert access_for("127.0.0.5", 1).token == "" and access_for("::1", 1).token == ""
    one, two = access_for("0.0.0.0", 1), access_for("192.168.1.4", 1)
    assert len(one.token) >= 20 and one.token != two.token
    assert one.token in one.url


def test_host_names_are_refused():
    with pytest.raises(InputError, match="numeric address"):
        access_for("localhost.example", 1)
