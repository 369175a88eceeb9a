"""Any bytes from anybody, and a great many of them: no exception, no growth, no way to a vehicle."""

import random
import time
import tracemalloc

from fleet import GCS, TOOL, Fleet, ack, attitude, command, heartbeat
from hypothesis import given
from hypothesis import strategies as st

KNOWN = [attitude(1), heartbeat(1), command(1, (1, 191)), command(2, (255, 190)), ack((1, 191))]


def datagram(rng):
    """Random, truncated, bent, joined or oversized."""
    kind = rng.random()
    if kind < 0.4:
        return rng.randbytes(rng.randrange(0, 300))
    whole = b"".join(rng.choice(KNOWN) for _ in range(rng.randrange(1, 6)))
    if kind < 0.6:
        return whole[: rng.randrange(len(whole))]
    if kind < 0.8:
        bent = bytearray(whole)
        bent[rng.randrange(len(bent))] ^= 1 << rng.randrange(8)
        return bytes(bent)
    if kind < 0.81:
        return rng.randbytes(9000)
    return rng.choice((b"\xfd", b"\xfe")) * rng.randrange(1, 600)


def senders(rng, fleet):
    fixed = [*fleet.address.values(), TOOL]
    return (
        rng.choice(fixed)
        if rng.random() < 0.7
        else (f"127.{rng.randrange(256)}.0.1", rng.randrange(1, 65536))
    )


def flood(fleet, rng, count):
    router, sockets = fleet.router, len(fleet.router.sockets)
    for i in range(count):
        router.on_datagram(rng.randrange(sockets), senders(rng, fleet), datagram(rng), 1e-3 * i)
        if i % 1000 == 0:
            router.tick(1e-3 * i)
            router.news()


def test_a_hundred_thousand_broken_datagrams_are_counted_and_leave_no_trace_in_memory():
    fleet, rng = Fleet(), random.Random(2)
    flood(fleet, rng, 10_000)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    began = time.process_time()
    flood(fleet, rng, 100_000)
    spent = time.process_time() - began
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 100_000
    assert spent < 60
    for why in ("garbage bytes", "wrong CRC", "stranger on a vehicle's link", "stranger on a serving socket"):
        assert fleet.router.counts.dropped[why] > 1000


def test_random_bytes_from_a_known_client_never_reach_a_vehicle_unless_they_may_be_a_newer_message():
    fleet, rng = Fleet(), random.Random(3)
    passed = 0
    for _ in range(20_000):
        passed += bool(fleet.say("program1", rng.randbytes(rng.randrange(1, 300))))
    assert passed <= 2
    assert fleet.router.counts.unknown >= passed


def test_after_a_flood_commands_and_streams_still_flow():
    fleet, rng = Fleet(), random.Random(4)
    flood(fleet, rng, 5_000)
    assert "autopilot1" in fleet.say("program1", command(1, (1, 191)))
    fleet.router.tick(1e6)  # the flood's tools are forgotten
    assert fleet.say("autopilot1", attitude(1))["program1"] == attitude(1)


addresses = st.tuples(
    st.sampled_from(["127.0.0.1", "127.54.0.1", "10.0.0.1"]), st.integers(0, 65535)
) | st.sampled_from([*Fleet().address.values(), TOOL, GCS])
pieces = st.lists(st.sampled_from(KNOWN) | st.binary(max_size=60), max_size=5).map(b"".join)


@given(st.lists(st.tuples(st.integers(0, 6), addresses, pieces | st.binary(max_size=300)), max_size=12))
def test_any_sequence_of_datagrams_is_survived_and_nothing_is_invented(datagrams):
    router = Fleet().router
    for i, (socket, sender, data) in enumerate(datagrams):
        for piece, destinations in router.on_datagram(socket, sender, data, float(i)):
            assert bytes(piece) in data
            assert (socket, sender) not in destinations
        router.tick(float(i))
