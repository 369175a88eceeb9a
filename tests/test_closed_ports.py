"""Receivers at whose ports no program listens: found in the kernel's tables, and never guessed."""

from __future__ import annotations

import socket

from arena.closed_ports import REFRESH_S, ClosedPorts

HEAD = "  sl  local_address rem_address   st\n"


def test_open_and_closed_ports_of_this_computer_are_told_apart():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.57.0.1", 0))
        listening = one.getsockname()
        ports = ClosedPorts([listening, ("127.57.0.1", 1)])
        ports.search()
        assert ports.now == {("127.57.0.1", 1)}
    ports.search()
    assert ports.now == {listening, ("127.57.0.1", 1)}


def test_port_that_is_open_for_ipv6_is_not_closed(tmp_path):
    (tmp_path / "udp").write_text(HEAD)
    (tmp_path / "udp6").write_text(f"{HEAD}  1: {'0' * 32}:38D6 {'0' * 32}:0000 07\n")
    ports = ClosedPorts([("127.0.0.1", 14550), ("127.0.0.1", 22001)], folder=tmp_path)
    ports.search()
    assert ports.now == {("127.0.0.1", 22001)}


def test_other_computers_are_never_closed():
    ports = ClosedPorts([("192.0.2.7", 1)])
    ports.search()
    assert not ports.now


def test_port_of_a_multicast_group_is_closed_until_it_is_opened():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("0.0.0.0", 0))
        group = ("239.255.57.1", one.getsockname()[1])
        ports = ClosedPorts([], group=group)
        ports.search()
        assert not ports.now
    ports.search()
    assert ports.now == {group}


def test_unreadable_tables_close_no_port(tmp_path):
    ports = ClosedPorts([("127.0.0.1", 1)], folder=tmp_path)
    ports.search()
    assert not ports.now
    (tmp_path / "udp").write_text(f"{HEAD} unreadable\n")
    ports.search()
    assert not ports.now


def test_search_is_not_repeated_before_its_time(tmp_path):
    table = tmp_path / "udp"
    table.write_text(HEAD)
    ports = ClosedPorts([("127.0.0.1", 14550)], folder=tmp_path)
    ports.refresh(5.0)
    assert ports.now
    table.write_text(f"{HEAD}  1: 0100007F:38D6 00000000:0000 07\n")
    ports.refresh(5.0 + REFRESH_S / 2)
    assert ports.now
    ports.refresh(5.0 + REFRESH_S)
    assert not ports.now
