"""Vehicle links: accepted senders, replies to the partner alone, and a flood on one link."""

from __future__ import annotations

import contextlib
import socket
import time

import pytest

from arena.errors import InputError, RunError
from arena.sim.vehicle_links import VehicleLinks, accepted_hosts

HOST = "127.55.2.1"


@contextlib.contextmanager
def opened(budget_s=1.0, count=1, **changes):
    """Yield the links of `count` vehicles (router and vision each), the partners' sockets and the slice's vehicles."""
    partners, vehicles = {}, []
    for i in range(count):
        links = {}
        for name in ("router", "vision"):
            partner = partners[i, name] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            partner.bind((HOST, 0))
            partner.settimeout(5.0)
            links[name] = {"local": [HOST, free_port()], "remote": list(partner.getsockname())}
        vehicles.append({"name": f"uav{i + 1}", "links": links})
    made = VehicleLinks(vehicles, budget_s=budget_s, **changes)
    try:
        yield made, partners, vehicles
    finally:
        made.close()
        for partner in partners.values():
            partner.close()


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]


def local(vehicles, i, name):
    return tuple(vehicles[i]["links"][name]["local"])


def drained(links):
    heard = []
    links.drain(lambda vehicle, link, data: heard.append((vehicle, link, data)))
    return heard


def test_datagrams_arrive_with_their_vehicle_and_link():
    with opened(count=2) as (links, partners, vehicles):
        partners[1, "vision"].sendto(b"pose", local(vehicles, 1, "vision"))
        partners[0, "router"].sendto(b"command", local(vehicles, 0, "router"))
        assert sorted(drained(links)) == [(0, "router", b"command"), (1, "vision", b"pose")]
        assert drained(links) == []


def test_any_sender_is_received_but_only_the_partner_gets_replies():
    with (
        opened() as (links, partners, vehicles),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        stranger.bind((HOST, 0))
        stranger.setblocking(False)
        stranger.sendto(b"x" * 60_000, local(vehicles, 0, "router"))
        assert drained(links) == [(0, "router", b"x" * 60_000)]
        links.send([(0, "router", b"answer")])
        assert partners[0, "router"].recv(100) == b"answer"
        with pytest.raises(BlockingIOError):
            stranger.recv(100)


def test_an_empty_datagram_is_received():
    with opened() as (links, partners, vehicles):
        partners[0, "router"].sendto(b"", local(vehicles, 0, "router"))
        partners[0, "router"].sendto(b"after", local(vehicles, 0, "router"))
        assert [data for _, _, data in drained(links)] == [b"", b"after"]


def test_a_flood_does_not_delay_the_other_link():
    with opened() as (links, partners, vehicles):
        for _ in range(150):
            partners[0, "router"].sendto(b"flood", local(vehicles, 0, "router"))
        partners[0, "vision"].sendto(b"pose", local(vehicles, 0, "vision"))
        heard = drained(links)
        assert (0, "vision", b"pose") in heard
        assert len(heard) == 65
        assert links.stats()["cut_short"] == 1


def test_reading_stops_when_its_time_budget_is_used():
    with opened(budget_s=0.01) as (links, partners, vehicles):
        for _ in range(50):
            partners[0, "router"].sendto(b"flood", local(vehicles, 0, "router"))
            partners[0, "vision"].sendto(b"pose", local(vehicles, 0, "vision"))
        heard = []

        def busy(vehicle, link, data):
            heard.append(link)
            until = time.monotonic() + 0.004
            while time.monotonic() < until:
                pass

        links.drain(busy)
        assert heard.count("router") == heard.count("vision") == 4


def test_a_partner_that_is_not_there_is_no_error():
    with opened() as (links, partners, _):
        partners[0, "router"].close()
        for _ in range(3):
            links.send([(0, "router", b"heartbeat"), (0, "vision", b"x"), (0, "panic", b"no such link")])
            drained(links)
        assert links.stats()["sent"] == 6


def test_a_reachable_link_accepts_only_its_own_and_partner_host():
    port, udp = free_port(), (socket.AF_INET, socket.SOCK_DGRAM)
    with socket.socket(*udp) as partner, socket.socket(*udp) as stranger:
        partner.bind((HOST, 0))
        stranger.bind(("127.55.2.9", 0))
        ends = {"panic": {"local": ["0.0.0.0", port], "remote": list(partner.getsockname())}}
        links = VehicleLinks([{"name": "uav1", "links": ends}], budget_s=1.0)
        try:
            for who in (stranger, partner, stranger):
                who.sendto(who.getsockname()[0].encode(), (HOST, port))
            assert drained(links) == [(0, "panic", HOST.encode())]
            assert links.stats()["strangers"] == 2 and links.stats()["received"] == 1
        finally:
            links.close()


@pytest.mark.parametrize(
    ("local", "remote", "heard"),
    [
        ("127.0.0.1", "127.0.0.1", set()),
        ("127.3.2.1", "127.0.0.1", set()),
        ("192.168.1.5", "192.168.1.5", {"192.168.1.5"}),
        ("10.0.0.2", "10.0.0.9", {"10.0.0.2", "10.0.0.9"}),
    ],
)
def test_accepted_hosts_depend_on_the_address(local, remote, heard):
    assert accepted_hosts(local, remote) == heard


def test_a_port_in_use_is_an_error_that_names_it():
    with (
        opened() as (_, _, vehicles),
        pytest.raises(RunError, match=f"uav1: vision link: cannot bind UDP {HOST}:"),
    ):
        VehicleLinks([{"name": "uav1", "links": {"vision": vehicles[0]["links"]["vision"]}}], budget_s=1.0)


def test_an_invalid_address_is_an_error():
    with pytest.raises(
        InputError, match=r"configuration of link uav1.router: local: got 'x', expected \[host, port\]"
    ):
        VehicleLinks(
            [{"name": "uav1", "links": {"router": {"local": "x", "remote": [HOST, 1]}}}], budget_s=1.0
        )
