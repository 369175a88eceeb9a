"""Datagrams that are read in batches and singly."""

from __future__ import annotations

import socket

import pytest

from arena.datagrams import read_datagrams, read_singly
from arena.transport import open_udp


@pytest.fixture
def sockets():
    made = [open_udp(("127.0.0.1", 0)) for _ in range(4)]
    yield made
    for each in made:
        each.close()


def sent(senders: list[socket.socket], receivers: list[socket.socket], count: int) -> list:
    """Send datagrams of many lengths to each receiver. Return (datagram, sender) of each, in order."""
    found = []
    for k in range(count):
        data, sender = bytes([k % 256]) * (0, 1, 60_000, 1500, 200)[k % 5], senders[k % len(senders)]
        for receiver in receivers:
            sender.sendto(data, receiver.getsockname())
        found.append((data, sender.getsockname()))
    return found


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 40])
def test_batches_and_single_reads_return_the_same(sockets, count):
    expected = sent(sockets[2:], sockets[:2], count)
    assert read_datagrams(sockets[0], 256) == expected == read_singly(sockets[1], 256)
    assert read_datagrams(sockets[0], 256) == []


@pytest.mark.parametrize("read", [read_datagrams, read_singly])
def test_later_datagrams_are_left_for_the_next_read(sockets, read):
    expected = sent(sockets[2:], sockets[:1], 40)
    assert [read(sockets[0], limit) for limit in (3, 16, 20, 5)] == [
        expected[:3],
        expected[3:19],
        expected[19:39],
        expected[39:],
    ]


@pytest.mark.parametrize("read", [read_datagrams, read_singly])
def test_nothing_is_read_from_a_closed_socket(sockets, read):
    sockets[0].close()
    assert read(sockets[0], 5) == []


def test_many_senders_have_their_own_addresses(sockets):
    for k in range(300):
        with open_udp((f"127.0.{k % 256}.{1 + k // 256}", 0)) as sender:
            sender.sendto(b"x", sockets[0].getsockname())
            assert read_datagrams(sockets[0], 5) == [(b"x", sender.getsockname())]
