"""Captured frames checked, converted and encoded by the compiled and by the interpreted kernels: equal results."""

from __future__ import annotations

import math
import random
from collections import Counter
from types import ModuleType

import pytest

from arena.kernels.capture_types import CapturedFrame, Echo, MeasuredBody, Pose
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAMES = ("captured_poses", "frame_order", "lateness", "natnet_bodies", "pose_selection")
INTERPRETED = interpreted_modules(*NAMES)
RATE, STALE_S = 180, 0.1


@pytest.fixture
def compiled() -> dict[str, ModuleType]:
    return compiled_modules(*NAMES)


def random_body(rng: random.Random, number: int) -> MeasuredBody:
    """Return a body with a random pose: sometimes far away, not finite, not normed, or not tracked."""
    quat = [rng.gauss(0, 1) for _ in range(4)]
    norm = math.sqrt(sum(x * x for x in quat)) * rng.choice([1.0, 1.0, 1.05, 1.2])
    place = [rng.gauss(0, 1) * rng.choice([1.0, 1.0, 1e5]) for _ in range(3)]
    if rng.random() < 0.1:
        place[rng.randrange(3)] = rng.choice([math.nan, math.inf, 1e300])
    x, y, z = place
    a, b, c, d = (x / norm for x in quat)
    return MeasuredBody(number, (x, y, z), (a, b, c, d), rng.random(), rng.random() < 0.9)


def random_frames(rng: random.Random, count: int) -> list[tuple[CapturedFrame, float, bool]]:
    """Return (frame, time of arrival [s], flying) of a stream with faults.

    Frames are lost, repeated, late, frozen and untracked. Stamps are wrong, clocks are set, and the server restarts.
    """
    found: list[tuple[CapturedFrame, float, bool]] = []
    number, offset_s, delay_s, echo = 0, 5.0, 0.01, None
    pose = Pose("uav1", (0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0))
    for k in range(count):
        now = k / RATE
        event = rng.random()
        number = (
            rng.randrange(20)
            if event < 0.004
            else number + rng.choice([0, 1, 1, 1, 1, 2, -1][: 7 if event < 0.3 else 5])
        )
        if rng.random() < 0.01:
            delay_s = rng.choice([0.01, 0.02, 0.09, 0.3])
        if rng.random() < 0.003:
            offset_s = rng.choice([5.0, -3.0, 100.0])
        if rng.random() < 0.05:
            echo = Echo(now - 0.002, now, now - 0.001 - offset_s)
        if rng.random() < 0.9:
            pose = Pose("uav1", (rng.gauss(0, 1), rng.choice([0.0, 1.0, 1e5, math.nan]), -1.0), pose.q_nb)
        others = [Pose(f"other{i}", pose.p_n, pose.q_nb) for i in range(rng.randrange(3))]
        seen = rng.random() < 0.95
        poses = [*others, pose] if seen else others
        untracked = () if seen or rng.random() < 0.5 else ("uav1",)
        exposed = now - delay_s - offset_s if rng.random() < 0.99 else rng.choice([math.nan, 1e9, math.inf])
        sent = rng.choice([None, exposed + 0.004, exposed - 1.0, exposed + 100.0])
        frame = CapturedFrame(number, exposed, tuple(poses), untracked, sent, echo)
        found.append((frame, now, 0.3 < k / count < 0.6))
    return found


def selected(
    modules: dict[str, ModuleType], frames: list[tuple[CapturedFrame, float, bool]], *, noisy: bool
) -> list[str]:
    """Return the results of a selection of poses as text, because a NaN differs from itself."""
    counts: Counter[str] = Counter()
    selection = modules["pose_selection"].PoseSelection("uav1", 3, STALE_S, noisy, counts)
    found = []
    for frame, now, flying in frames:
        selection.flying = flying
        pose = selection.take(frame, now)
        late = selection.lateness
        found.append(
            repr((pose, selection.late_s, late.latency_s, late.clock_error_s, late.shifts, selection.resets))
        )
    return [*found, repr(counts)]


@needs_compiled
@pytest.mark.parametrize("noisy", [True, False])
def test_compiled_and_interpreted_selection_forward_the_same_poses(compiled, noisy):
    counts: Counter[str] = Counter()
    for seed in range(6):
        frames = random_frames(random.Random(seed), 1500)
        expected = selected(INTERPRETED, frames, noisy=noisy)
        assert selected(compiled, frames, noisy=noisy) == expected
        counts += eval(expected[-1], {"Counter": Counter})
    reasons = {"repeated frame", "capture restarts", "untracked", "body not in frame", "no pose", "stale"}
    assert set(counts) == reasons | ({"frozen"} if noisy else set())


@needs_compiled
def test_compiled_and_interpreted_selection_of_several_frames_is_the_same(compiled):
    found = []
    for modules in (INTERPRETED, compiled):
        rng, counts = random.Random(3), [Counter(), Counter()]
        frames = random_frames(rng, 1500)
        kernel = modules["pose_selection"]
        selections = [kernel.PoseSelection("uav1", 3, STALE_S, True, each) for each in counts]
        results = []
        while frames:
            taken, frames = frames[: rng.randrange(1, 7)], frames[6:]
            selections[1].flying = taken[0][2]
            given = [frame for frame, _, _ in taken]
            results.append(repr(kernel.newest_poses(selections, given, taken[-1][1])))
        found.append((results, counts))
    assert found[0] == found[1]
    assert found[0][1][0]["superseded"] > 10
    assert all(any(part in text for text in found[0][0]) for part in ("[]", "(0, Pose", "(1, Pose"))


@needs_compiled
def test_compiled_and_interpreted_conversion_give_the_same_poses(compiled):
    rng = random.Random(2)
    names = {k: f"uav{k}" for k in range(20)}
    untracked = 0
    for _ in range(200):
        bodies = [random_body(rng, k) for k in range(rng.randrange(20))]
        found = compiled["captured_poses"].measured_poses(bodies, names)
        assert found == INTERPRETED["captured_poses"].measured_poses(bodies, names)
        assert {pose.body for pose in found[0]} | set(found[1]) == {names[body.number] for body in bodies}
        untracked += len(found[1])
    assert untracked > 200


@needs_compiled
def test_compiled_and_interpreted_code_write_the_same_pose_page(compiled):
    rng = random.Random(4)
    begins = {f"uav{k}": 9 * k for k in range(0, 20, 2)}
    pages = [memoryview(bytearray(8 * 9 * 20)).cast("d") for _ in range(2)]
    for _ in range(50):
        bodies = [random_body(rng, k) for k in range(rng.randrange(20))]
        poses, _ = INTERPRETED["captured_poses"].measured_poses(bodies, {k: f"uav{k}" for k in range(20)})
        for module, page in zip((compiled, INTERPRETED), pages, strict=True):
            module["captured_poses"].store_poses(poses, begins, page)
    assert bytes(pages[0]) == bytes(pages[1])
    assert pages[0][0] > 10 and pages[0][9] == 0.0


@needs_compiled
def test_compiled_and_interpreted_encoder_give_the_same_bytes(compiled):
    rng = random.Random(3)
    encoders = [m["natnet_bodies"].BodyEncoder(1) for m in (compiled, INTERPRETED)]
    for _ in range(100):
        bodies = [random_body(rng, rng.randrange(-(1 << 31), 1 << 31)) for _ in range(rng.randrange(20))]
        one, other = (encoder.encode(bodies) for encoder in encoders)
        assert one == other
        assert len(one) == 38 * len(bodies)
