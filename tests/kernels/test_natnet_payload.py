"""NatNet payloads read by the compiled and by the interpreted kernel: equal bodies, positions and errors."""

from __future__ import annotations

import math
import random
from types import ModuleType

from arena.errors import WireError
from arena.mocap.natnet import codec
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

INTERPRETED = interpreted_modules("natnet_payload")["natnet_payload"]
SIZED = {(3, 1): False, (4, 1): True}


def payloads(rng: random.Random, version: codec.Version) -> list[bytes]:
    """Return the payloads of a frame, of a truncated frame, of a frame with a wrong byte, and of garbage."""
    bodies = tuple(
        codec.Body(rng.randrange(-3, 20), (1.0, rng.gauss(0, 1), math.nan), (0.0, 0.0, 0.6, 0.8), 0.1)
        for _ in range(rng.randrange(5))
    )
    frame = codec.Frame(number=rng.randrange(1 << 31), timestamp_s=1.5, exposure_ticks=9, bodies=bodies)
    whole = codec.encode_frame(frame, version)[4:]
    wrong = bytearray(whole)
    wrong[rng.randrange(len(wrong))] = rng.randrange(256)
    return [whole, whole[: rng.randrange(len(whole))], bytes(wrong), rng.randbytes(rng.randrange(80))]


def read(module: ModuleType, payload: bytes, sized: bool, wanted: set[int] | None) -> list[str]:
    """Return what a reader finds in a payload as text, because a NaN differs from itself; at the end an error, if there is one."""
    found: list[str] = []
    try:
        reader = module.PayloadReader(payload)
        found.append(repr((reader.i32(), reader.at)))
        found.append(repr((reader.bodies(wanted, sized), reader.at)))
        reader.skip_to_stamps(sized)
        found.append(repr((reader.u16(), reader.at)))
        found.append(repr((reader.text(), reader.at)))
    except WireError as error:
        found.append(str(error))
    return found


def read_packet(module: ModuleType, packet: bytes, version: codec.Version, wanted: set[int] | None) -> str:
    """Return the whole frame that a reader finds in a packet, or its error, as text."""
    try:
        payload = module.payload_of(packet, codec.FRAME)
        return repr(module.PayloadReader(payload).frame(wanted, version, version <= (4, 2)))
    except WireError as error:
        return str(error)


@needs_compiled
def test_compiled_and_interpreted_reader_find_the_same_frames():
    compiled = compiled_modules("natnet_payload")["natnet_payload"]
    rng, errors, frames = random.Random(4), 0, 0
    for _ in range(400):
        for sent, said in (((3, 1), (3, 1)), ((4, 1), (4, 1)), ((4, 1), (4, 5)), ((3, 1), (4, 5))):
            wanted = rng.choice([None, {1, 2, 3, -1}])
            for payload in payloads(rng, sent):
                message, cut = rng.choice([codec.FRAME] * 9 + [codec.MODELDEF]), rng.choice([0, 0, 0, 1, 3])
                packet = codec.packet(message, payload)
                for data in (packet, packet + b"more", packet[: len(packet) - cut], packet[:cut]):
                    expected = read_packet(INTERPRETED, data, said, wanted)
                    assert read_packet(compiled, data, said, wanted) == expected
                    errors += not expected.startswith("(")
                    frames += expected.startswith("(")
    assert errors > 1000 and frames > 1000


@needs_compiled
def test_compiled_and_interpreted_reader_find_the_same():
    compiled = compiled_modules("natnet_payload")["natnet_payload"]
    rng, errors = random.Random(3), 0
    for _ in range(400):
        for version, sized in SIZED.items():
            wanted = rng.choice([None, {1, 2, 3, -1}])
            for payload in payloads(rng, version):
                expected = read(INTERPRETED, payload, sized, wanted)
                assert read(compiled, payload, sized, wanted) == expected
                errors += expected[-1].startswith("NatNet")
    assert errors > 200
