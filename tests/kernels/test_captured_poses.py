"""Captured poses converted by the compiled and by the interpreted kernel: equal, bit for bit."""

from __future__ import annotations

import math
import random
from types import ModuleType

import pytest

from arena.mocap.client.pose import Pose
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

INTERPRETED = interpreted_modules("captured_poses")["captured_poses"]
VERSIONS = [
    pytest.param(INTERPRETED, id="interpreted"),
    pytest.param(compiled_modules("captured_poses")["captured_poses"], id="compiled", marks=needs_compiled),
]


def raw_body(rng: random.Random, number: int) -> tuple:
    """Return a body of a NatNet frame: valid, untracked, far away, not finite, or with a wrong quaternion."""
    q = [rng.gauss(0, 1) for _ in range(4)]
    norm = math.sqrt(sum(x * x for x in q)) * rng.choice([1.0, 1.0, 1.0, 0.5])
    place = [rng.choice([*[rng.gauss(0, 3)] * 18, 2e4, math.nan]) for _ in range(3)]
    return (number, *place, *(x / norm for x in q), 0.1, rng.choice([1, 1, 1, 0, 3, 2]))


@needs_compiled
def test_compiled_and_interpreted_kernel_convert_to_the_same_poses():
    compiled, rng, poses = compiled_modules("captured_poses")["captured_poses"], random.Random(7), 0
    names = {i: f"uav{i}" for i in range(20)}
    for _ in range(500):
        bodies = [raw_body(rng, i) for i in rng.sample(range(20), rng.randrange(6))]
        left_out = {"uav3": 3, "uav4": 4}
        expected = INTERPRETED.natnet_poses(bodies, names, left_out)
        found = compiled.natnet_poses(bodies, names, left_out)
        assert repr(found) == repr(expected) and all(type(pose) is Pose for pose in found[0])
        poses += len(expected[0])
        for body in bodies:
            assert repr(compiled.ned_pose("uav", *body[1:8])) == repr(INTERPRETED.ned_pose("uav", *body[1:8]))
    assert poses > 300


@pytest.mark.parametrize("module", VERSIONS)
def test_body_without_a_pose_is_named_and_an_invalid_pose_is_counted(module: ModuleType) -> None:
    level, broken = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)
    bodies = [
        (1, 1.0, 2.0, 3.0, *level, 0.1, 1),
        (2, 1.0, 2.0, 3.0, *level, 0.1, 0),  # not tracked
        (3, 1.0, 2.0, 3.0, *broken, 0.1, 1),
        (4, 1.0, 2.0, 3.0, *level, 0.1, 1),  # left out
    ]
    names = {i: f"uav{i}" for i in range(1, 5)}
    poses, untracked, invalid = module.natnet_poses(bodies, names, {"uav4"})
    assert [(pose.body, pose.p_n) for pose in poses] == [("uav1", (2.0, 1.0, -3.0))]
    assert (untracked, invalid) == (["uav2", "uav3"], 1)
