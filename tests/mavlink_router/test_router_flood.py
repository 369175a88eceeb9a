"""Random and broken datagrams, many of them: no exception, no memory growth, nothing reaches a vehicle."""

import gc
import random
import tracemalloc

from fleet import GCS, RECORDER, TOOL, Fleet, ack, attitude, command, heartbeat
from hypothesis import example, given
from hypothesis import strategies as st

KNOWN = [attitude(1), heartbeat(1), command(1, (1, 191)), command(2, (255, 190)), ack((1, 191))]


def datagram(rng):
    """Return a random, truncated, corrupted, joined or oversized datagram."""
    kind = rng.random()
    if kind < 0.4:
        return rng.randbytes(rng.randrange(0, 300))
    whole = b"".join(rng.choice(KNOWN) for _ in range(rng.randrange(1, 6)))
    if kind < 0.6:
        return whole[: rng.randrange(len(whole))]
    if kind < 0.8:
        corrupted = bytearray(whole)
        corrupted[rng.randrange(len(corrupted))] ^= 1 << rng.randrange(8)
        return bytes(corrupted)
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


def flood(fleet, rng, count, first=0):
    """Send `count` datagrams, one per millisecond, from millisecond `first` on."""
    router, sockets = fleet.router, len(fleet.router.sockets)
    for i in range(first, first + count):
        router.on_datagram(rng.randrange(sockets), senders(rng, fleet), datagram(rng), 1e-3 * i)
        if i % 1000 == 0:
            router.tick(1e-3 * i)
            router.changed_facts()
            router.commands.take_audit()


def test_broken_datagrams_are_counted_and_leave_no_memory():
    fleet, rng = Fleet(), random.Random(2)
    tracemalloc.start()
    flood(fleet, rng, 10_000)  # fill the bounded tables
    gc.collect()  # frees the lists of unused tuples too, whose length is chance
    before = tracemalloc.get_traced_memory()[0]
    flood(fleet, rng, 25_000, first=10_000)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 25_000, "one byte per datagram would be a leak"
    for why in (
        "garbage bytes",
        "wrong CRC",
        "unknown sender on a vehicle's link",
        "unknown sender on a client socket",
    ):
        assert fleet.router.counts.dropped[why] > 200


def test_random_bytes_of_a_client_do_not_reach_a_vehicle():
    fleet, rng = Fleet(), random.Random(3)
    passed = 0
    for _ in range(20_000):
        passed += bool(fleet.send_as("program1", rng.randbytes(rng.randrange(1, 300))))
    assert passed <= 2
    assert fleet.router.counts.unknown >= passed


def test_commands_and_streams_pass_after_a_flood():
    fleet, rng = Fleet(), random.Random(4)
    flood(fleet, rng, 5_000)
    assert "autopilot1" in fleet.send_as("program1", command(1, (1, 191)))
    fleet.router.tick(1e6)  # removes the tools of the flood
    assert fleet.send_as("autopilot1", attitude(1))["program1"] == attitude(1)


addresses = st.tuples(
    st.sampled_from(["127.0.0.1", "127.54.0.1", "10.0.0.1"]), st.integers(0, 65535)
) | st.sampled_from([*Fleet().address.values(), TOOL, GCS])
pieces = st.lists(st.sampled_from(KNOWN) | st.binary(max_size=60), max_size=5).map(b"".join)


@given(st.lists(st.tuples(st.integers(0, 6), addresses, pieces | st.binary(max_size=300)), max_size=12))
@example([(5, RECORDER, command(2, (255, 190)))])
def test_any_datagrams_are_routed_without_error_as_slices(datagrams):
    router = Fleet().router
    for i, (socket, sender, data) in enumerate(datagrams):
        for piece, destinations in router.on_datagram(socket, sender, data, float(i)):
            assert bytes(piece) in data
            assert sender == RECORDER or (socket, sender) not in destinations, (
                "the recorder gets a copy of all"
            )
        router.tick(float(i))
