"""Ordinary poses and setpoints read by the compiled and by the interpreted kernel, compared with each other and with pymavlink."""

from __future__ import annotations

import math
import random
import struct
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import SEEDS, parse_frames
from tests.kernels.kernel_versions import arrays_of, compiled_modules, interpreted_modules, needs_compiled

NAMES = (
    "strapdown",
    "error_covariance",
    "vision_fusion",
    "vision_input",
    "offboard_setpoints",
    "ordinary_messages",
)
INTERPRETED = interpreted_modules(*NAMES)
VERSIONS = [
    pytest.param(INTERPRETED, id="interpreted"),
    pytest.param(compiled_modules(*NAMES), id="compiled", marks=needs_compiled),
]
IDS = [3, 9]
FLOATS = (0.0, -0.0, 1.0, -2.5, math.nan, math.inf, 1e4, 9999.0, 1e6, 1.1e6, 3e38)


class Readers:
    """Reader of ordinary messages to two vehicles, with the kernels that receive poses and setpoints."""

    def __init__(self, modules: dict[str, ModuleType]) -> None:
        aligned, count = np.zeros(2, bool), len(IDS)
        state = modules["strapdown"].Strapdown(aligned, 0.004, 0.02, 20)
        covariance = modules["error_covariance"].ErrorCovariance(
            0.004, 2, state.r_nb, state.force_b, state.omega_b
        )
        fusion = modules["vision_fusion"].VisionFusion(
            state, covariance, np.full(count, 11), np.zeros(count, int)
        )
        self.vision = modules["vision_input"].VisionInput(fusion, np.zeros(count, bool))
        q_nb = np.array([[1.0, 0.0, 0.0, 0.0], [0.8, 0.36, -0.48, 0.0]])
        self.offboard = modules["offboard_setpoints"].OffboardSetpoints(memoryview(q_nb))
        self.asked: list[float] = []
        self.passes = True
        self.reader = modules["ordinary_messages"].OrdinaryMessages(
            memoryview(np.array(IDS)),
            self.vision,
            self.offboard,
            SEEDS,
            ["router", "vision"],
            [self._ask, self._ask],
        )

    def _ask(self, now: float) -> bool:
        """Note that the authority was asked, and that nothing of the setpoint had been stored."""
        assert not np.isin(now, arrays_of(self.offboard)["received_at"])
        self.asked.append(now)
        return self.passes

    def state(self) -> list[bytes]:
        """Return all arrays. The sign of NaN is not compared."""
        found = [*arrays_of(self.vision).items(), *arrays_of(self.offboard).items()]
        return [np.nan_to_num(each.astype(float), nan=12345.0).tobytes() for _, each in sorted(found)]


def sender(system: int, component: int = 191) -> Any:
    return mavlink.MAVLink(None, srcSystem=system, srcComponent=component)


def number(rng: random.Random) -> float:
    drawn = rng.choice((rng.gauss(0, 3), rng.gauss(0, 3), rng.choice(FLOATS)))
    value: float = struct.unpack("<f", struct.pack("<f", drawn))[0]
    return value


def odometry(rng: random.Random) -> Any:
    q = [rng.gauss(0, 1) for _ in range(4)]
    norm = math.sqrt(sum(x * x for x in q)) / rng.choice((1.0, 1.0, 1.05, 1.2))
    q = [x / norm for x in q] if rng.random() < 0.9 else [number(rng) for _ in range(4)]
    return mavlink.MAVLink_odometry_message(
        rng.getrandbits(64),
        rng.choice((1, 1, 1, 20, 8)),
        rng.getrandbits(8),
        *(number(rng) for _ in range(3)),
        q,
        *(number(rng) for _ in range(6)),
        [number(rng) for _ in range(21)],
        [number(rng) for _ in range(21)],
        rng.getrandbits(8),
        rng.choice((0, 2, 2, 3, 6)),
        rng.choice((0, 100)),
    )


def setpoint(rng: random.Random, system: int) -> Any:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        rng.getrandbits(32),
        rng.choice((system, system, system, 0, 5)),
        rng.choice((1, 1, 1, 0, 7)),
        rng.choice((1, 1, 8, 7)),
        rng.choice((0b100111111000, 0b010111000111, 0, rng.getrandbits(12), rng.getrandbits(16))),
        *(number(rng) for _ in range(11)),
    )


def datagram(rng: random.Random, i: int) -> bytes:
    """Return a datagram with one message to vehicle i; some are changed so that they are not ordinary."""
    message = odometry(rng) if rng.random() < 0.5 else setpoint(rng, IDS[i])
    by = sender(rng.choice((IDS[i], IDS[i], IDS[i], 255)), rng.choice((191, 191, 191, 1)))
    data, kind = bytes(message.pack(by)), rng.random()
    if kind < 0.05:
        return data[: rng.randrange(len(data))]
    if kind < 0.1:
        return data + data
    if kind < 0.15:
        k = rng.randrange(len(data))
        return data[:k] + bytes([data[k] ^ 1 << rng.randrange(8)]) + data[k + 1 :]
    return data


@needs_compiled
def test_compiled_and_interpreted_reader_store_the_same() -> None:
    rng = random.Random(1)
    compiled, source = Readers(VERSIONS[1].values[0]), Readers(INTERPRETED)  # type: ignore[attr-defined]
    ordinary = 0
    for step in range(3000):
        i, now = rng.randrange(2), 0.01 * step
        data, link = datagram(rng, i), rng.choice(("router", "router", "vision", "ground", "panic"))
        flying, passes = rng.random() < 0.5, rng.random() < 0.8
        for each in (compiled, source):
            each.vision.flying[i], each.passes = flying, passes
        found = [each.reader.receive(i, link, data, now) for each in (compiled, source)]
        assert found[0] == found[1] and compiled.asked == source.asked, data.hex()
        assert compiled.state() == source.state(), data.hex()
        ordinary += found[0]
        if not found[0]:
            for frame in parse_frames(data).frames:
                refusals = [read_frame(each, i, data, frame, now) for each in (compiled, source)]
                assert refusals[0] == refusals[1] and compiled.state() == source.state(), data.hex()
    assert 300 < ordinary < 2700


def read_frame(readers: Readers, i: int, data: bytes, frame: Any, now: float) -> str | None:
    """Read a frame of a datagram that is not ordinary, as `MavlinkInterface` does. Return the refusal of a setpoint."""
    if frame.msgid == 331:
        readers.reader.read_pose(i, data, frame.payload, frame.size)
        return None
    refusal: str | None = readers.reader.read_setpoint(i, data, frame.payload, frame.size, now)
    return refusal


@pytest.mark.parametrize("modules", VERSIONS)
def test_pose_has_the_values_of_pymavlink(modules: dict[str, ModuleType]) -> None:
    rng, readers = random.Random(2), Readers(modules)
    poses = arrays_of(readers.vision)["pose"]
    for _ in range(200):
        m = odometry(rng)
        m.x, m.y, m.z, m.frame_id, m.estimator_type = rng.random(), rng.random(), -rng.random(), 1, 2
        m.q, m.quality = [0.6, 0.0, -0.8, 0.0], rng.choice((0, 100))
        data = bytes(m.pack(sender(IDS[1], 197)))
        assert readers.reader.receive(1, "vision", data, 1.0)
        sent = mavlink.MAVLink(None).decode(bytearray(data))
        q = np.array(sent.q)
        variances = [sent.pose_covariance[k] for k in (0, 6, 11, 20)]
        expected = [x if 0.0 < x < math.inf else 0.0 for x in variances]
        assert poses[1].tolist() == pytest.approx([sent.x, sent.y, sent.z, *q / np.linalg.norm(q), *expected])
    assert np.asarray(readers.vision.counts).tolist() == [[0, 0, 0], [200, 0, 0]]
    assert np.isnan(poses[0]).all()


@pytest.mark.parametrize("modules", VERSIONS)
def test_truncated_pose_is_completed_by_zeros(modules: dict[str, ModuleType]) -> None:
    readers, zeros = Readers(modules), [0] * 21
    m = mavlink.MAVLink_odometry_message(1, 1, 0, 2.0, 0, 0, [0] * 4, *[0] * 6, zeros, zeros)
    data = bytes(m.pack(sender(3, 197)))
    assert data[1] == 229 and not readers.reader.receive(0, "ground", data, 1.0)
    assert readers.reader.receive(0, "vision", data, 1.0)
    assert np.asarray(readers.vision.counts)[0].tolist() == [1, 0, 0]
    pose = arrays_of(readers.vision)["pose"][0]
    assert pose[[0, 1, 2, 7, 8, 9, 10]].tolist() == [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert np.isnan(pose[3:7]).all()


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("modules", VERSIONS)
def test_setpoint_has_the_values_of_pymavlink(modules: dict[str, ModuleType], version: int) -> None:
    rng, readers = random.Random(3), Readers(modules)
    found = arrays_of(readers.offboard)
    for step in range(200):
        values = [rng.choice((0.0, rng.gauss(0, 3))) for _ in range(11)]
        m = mavlink.MAVLink_set_position_target_local_ned_message(7, 3, 1, 1, 0, *values)
        data = bytes(m.pack(sender(3), force_mavlink1=version == 1))
        sent = mavlink.MAVLink(None).decode(bytearray(data))
        ordinary = readers.reader.receive(0, "router", data, 1.0 + step)
        assert ordinary == (version == 2)
        if not ordinary:
            read_frame(readers, 0, data, parse_frames(data).frames[0], 1.0 + step)
        assert found["received_at"].tolist() == [1.0 + step, -1e9]
        assert [*found["p_n"][0], *found["v_n"][0], *found["a_n"][0]] == [
            *(sent.x, sent.y, sent.z, sent.vx, sent.vy, sent.vz, sent.afx, sent.afy, sent.afz)
        ]
        assert (found["yaw"][0], found["yaw_rate"][0]) == (sent.yaw, sent.yaw_rate)


@pytest.mark.parametrize("modules", VERSIONS)
def test_authority_is_asked_before_a_setpoint_is_stored(modules: dict[str, ModuleType]) -> None:
    readers = Readers(modules)
    m = mavlink.MAVLink_set_position_target_local_ned_message(0, 3, 1, 1, 0b100111111000, 1, 2, -3, *[0] * 8)
    data = bytes(m.pack(sender(3)))
    before = readers.state()
    readers.passes = False
    assert not readers.reader.receive(0, "router", data, 1.0)
    assert readers.asked == [1.0] and readers.state() == before
    readers.passes = True
    assert readers.reader.receive(0, "router", data, 2.0)
    assert readers.asked == [1.0, 2.0] and readers.offboard.received_at[0] == 2.0


@pytest.mark.parametrize("modules", VERSIONS)
def test_what_is_not_ordinary_asks_and_stores_nothing(modules: dict[str, ModuleType]) -> None:
    rng, readers = random.Random(4), Readers(modules)
    signer = sender(3)
    signer.signing.secret_key, signer.signing.sign_outgoing = bytes(range(32)), True
    own, other = setpoint(rng, 3), setpoint(rng, 3)
    own.target_system = other.target_system = 3
    own.target_component, other.target_component = 1, 7
    whole = bytes(own.pack(sender(3)))
    refused = [
        *(
            bytes(own.pack(sender(*by))) for by in ((255, 190), (9, 191), (3, 1))
        ),  # another sender; its own echo
        bytes(other.pack(sender(3))),
        bytes(own.pack(signer)),
        bytes(own.pack(sender(3), force_mavlink1=True)),
        whole + whole,
        whole[:-1],
        whole[:-1] + bytes([whole[-1] ^ 1]),
        bytes(odometry(rng).pack(sender(3, 1))),
        bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(sender(3))),
        b"",
    ]
    before = readers.state()
    for data in refused:
        assert not readers.reader.receive(0, "router", data, 1.0), data.hex()
    for link in ("ground", "panic"):
        assert not readers.reader.receive(0, link, whole, 1.0)
    assert not readers.reader.receive(0, "router", bytearray(whole), 1.0)
    assert readers.asked == [] and readers.state() == before
