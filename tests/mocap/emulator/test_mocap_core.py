"""The emulated cameras: noise, occlusion, frozen poses."""

from __future__ import annotations

import numpy as np

from arena.mocap.emulator.core import EmulatedCameras
from arena.mocap.natnet import codec as natnet
from arena.wire.truth_page import Truth

from ..rig import NatNetRig, row, settings


def still(bodies: int = 1) -> Truth:
    z = np.zeros((bodies, 3))
    return Truth(
        time_s=0.0,
        p_n=z + 1.0,
        q_nb=np.tile([1.0, 0, 0, 0], (bodies, 1)),
        v_n=z,
        omega_b=z,
        accel_b=z,
        motors=np.zeros((bodies, 4)),
    )


def body(packet: bytes) -> natnet.Body:
    return natnet.decode_frame(packet, (3, 1)).bodies[0]


def test_noise_has_its_size_and_does_not_accumulate():
    rig, truth = NatNetRig(settings()), still()
    found = np.array([body(rig.packet(n, truth)).position for n in range(4000)])
    assert np.allclose(found.std(0), 0.002, rtol=0.1)
    assert np.allclose(found[-500:].mean(0), [1.0, 1.0, -1.0], atol=0.0005)
    assert np.array_equal(truth.p_n, still().p_n)
    assert np.array_equal(truth.q_nb, still().q_nb)


def test_same_seed_gives_the_same_frames():
    a, b = NatNetRig(settings()), NatNetRig(settings())
    assert [a.packet(n, still()) for n in range(5)] == [b.packet(n, still()) for n in range(5)]
    assert NatNetRig(settings(seed=2)).packet(0, still()) != NatNetRig(settings()).packet(0, still())


def test_another_body_does_not_change_the_noise_of_a_body():
    first, own = {"name": "uav0", "number": 2, "index": 0}, {"name": "uav1", "number": 4, "index": 1}
    alone = EmulatedCameras(settings(bodies=[own]))
    among = EmulatedCameras(settings(bodies=[first, own, {"name": "uav2", "number": 9, "index": 2}]))
    for n in range(200):
        (measured,) = alone.measure(n, row(still(3))).bodies
        others = among.measure(n, row(still(3))).bodies
        assert others[1] == measured
        assert len({body.position_w for body in others}) == 3


def test_occluded_body_is_sent_at_its_last_pose_as_not_tracked():
    rig = NatNetRig(settings())
    seen = body(rig.packet(0, still()))
    rig.cameras.set_occluded("uav1", True)
    lost = body(rig.packet(1, still()))
    assert lost.position == seen.position
    assert seen.tracked
    assert not lost.tracked
    rig.cameras.set_occluded("uav1", False)
    assert body(rig.packet(2, still())).tracked


def test_frozen_body_keeps_its_pose_and_stays_tracked():
    rig = NatNetRig(settings())
    seen = body(rig.packet(0, still()))
    rig.cameras.set_frozen("uav1", True)
    stuck = body(rig.packet(1, still()))
    assert (stuck.position, stuck.tracked) == (seen.position, True)


def test_frozen_body_that_is_occluded_is_not_tracked():
    rig = NatNetRig(settings())
    rig.cameras.set_frozen("uav1", True)
    seen = body(rig.packet(0, still()))
    assert body(rig.packet(1, still())) == seen
    rig.cameras.set_occluded("uav1", True)
    lost = body(rig.packet(2, still()))
    assert (lost.position, lost.tracked) == (seen.position, False)


def test_body_after_an_occlusion_follows_the_truth_again():
    rig = NatNetRig(settings())
    first = body(rig.packet(0, still()))
    rig.cameras.set_occluded("uav1", True)
    rig.packet(1, still())
    rig.cameras.set_occluded("uav1", False)
    again = body(rig.packet(2, still()))
    assert again.tracked
    assert again.position != first.position
