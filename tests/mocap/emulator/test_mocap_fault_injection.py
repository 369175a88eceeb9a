"""Fault injection in the emulated cameras, as the client and the forwarder receive it."""

from __future__ import annotations

import numpy as np
import pytest

from arena.errors import InputError
from arena.geometry import quat_conj, quat_from_euler, quat_multiply, quat_rotate
from arena.mocap.emulator.fault_injection import apply_fault
from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet.receiver import NatNetReceiver
from arena.pose_forwarder.forwarder import Forwarder
from arena.wire.truth_page import Truth

from ..rig import NatNetRig, row, settings

NAMES = ["uav1", "aero2", "uav3"]
P_N = np.array([[1.25, -0.5, -1.75], [-2.0, 3.0, -0.5], [0.5, 0.25, -2.25]])
Q_NB = quat_from_euler(np.radians([[10.0, -20.0, 35.0], [-15.0, 5.0, 100.0], [25.0, 30.0, -160.0]]))


def make_rig(noise_m: float = 0.0, noise_deg: float = 0.0) -> NatNetRig:
    bodies = [{"name": n, "number": 10 + i, "index": 2 - i} for i, n in enumerate(NAMES)]
    noise = {"position_m": noise_m, "rotation_deg": noise_deg}
    return NatNetRig(settings(version="4.1", noise=noise, bodies=bodies))


def truth(time_s: float = 0.0) -> Truth:
    """Rows of the page are in another order than the bodies. They drift, so that no pose is the last one's."""
    z = np.zeros((3, 3))
    p_n = P_N[::-1] + np.array([0.1 * time_s, 0.0, 0.0])
    return Truth(
        time_s=time_s, p_n=p_n, q_nb=Q_NB[::-1], v_n=z, omega_b=z, accel_b=z, motors=np.zeros((3, 4))
    )


class Client:
    """A NatNet client behind emulated cameras."""

    def __init__(self, rig: NatNetRig) -> None:
        self.rig, self.cameras, self.receiver, self.number = rig, rig.cameras, NatNetReceiver(NAMES), 0
        for request in (natnet.CONNECT, natnet.REQUEST_MODELDEF):
            self.receiver.receive(rig.reply(natnet.packet(request)))

    def next_poses(self):
        """Return the tracked bodies of one more frame, name -> Pose."""
        self.number += 1
        frame = self.receiver.receive(self.rig.packet(self.number, truth()))
        return {p.body: p for p in frame.poses}


@pytest.fixture
def client():
    return Client(make_rig())


def test_without_faults_each_body_is_where_the_truth_is(client):
    seen = client.next_poses()
    for i, name in enumerate(NAMES):
        assert seen[name].p_n == pytest.approx(P_N[i], abs=1e-6)
        assert abs(np.dot(seen[name].q_nb, Q_NB[i])) == pytest.approx(1.0, abs=1e-9)


def test_jump_shifts_one_body_in_ned_and_turns_it_clockwise(client):
    event = apply_fault(
        client.cameras, {"do": "jump", "body": "aero2", "by_m": [1, -0.5, 0.25], "yaw_deg": 40}
    )
    assert event == "the pose of aero2 is shifted by 1 -0.5 0.25 m and 40 deg"
    seen = client.next_poses()
    assert np.subtract(seen["aero2"].p_n, P_N[1]) == pytest.approx([1, -0.5, 0.25], abs=1e-6)
    turn_n = quat_multiply(np.array(seen["aero2"].q_nb), quat_conj(Q_NB[1]))
    assert quat_rotate(turn_n, [1.0, 0.0, 0.0]) == pytest.approx(
        [np.cos(np.radians(40)), np.sin(np.radians(40)), 0.0], abs=1e-6
    )
    assert quat_rotate(turn_n, [0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert seen["uav1"].p_n == pytest.approx(P_N[0], abs=1e-6)
    apply_fault(client.cameras, {"do": "jump", "body": "aero2", "by_m": [0, 2, 0]})
    assert np.subtract(client.next_poses()["aero2"].p_n, P_N[1]) == pytest.approx([0, 2, 0], abs=1e-6), (
        "from where it is, not further"
    )
    assert (
        apply_fault(client.cameras, {"do": "jump", "body": "aero2", "by_m": [0, 0, 0]})
        == "the pose of aero2 is no longer shifted"
    )
    back = client.next_poses()["aero2"]
    assert back.p_n == pytest.approx(P_N[1], abs=1e-6) and abs(np.dot(back.q_nb, Q_NB[1])) == pytest.approx(
        1.0, abs=1e-9
    )


def test_swapped_bodies_have_each_others_pose_until_the_swap_ends(client):
    event = apply_fault(client.cameras, {"do": "swap", "bodies": ["uav1", "uav3"], "on": True})
    assert event == "uav1 and uav3 are swapped"
    seen = client.next_poses()
    assert seen["uav1"].p_n == pytest.approx(P_N[2], abs=1e-6) and seen["uav3"].p_n == pytest.approx(
        P_N[0], abs=1e-6
    )
    assert abs(np.dot(seen["uav1"].q_nb, Q_NB[2])) == pytest.approx(1.0, abs=1e-9)
    assert seen["aero2"].p_n == pytest.approx(P_N[1], abs=1e-6)
    apply_fault(client.cameras, {"do": "swap", "bodies": ["uav1", "uav3"], "on": True})
    assert client.next_poses()["uav1"].p_n == pytest.approx(P_N[2], abs=1e-6), "a repeated fault swaps once"
    apply_fault(client.cameras, {"do": "swap", "bodies": ["uav3", "uav1"], "on": False})
    assert client.next_poses()["uav1"].p_n == pytest.approx(P_N[0], abs=1e-6)


def test_dropout_and_frozen_pose_affect_one_body_and_end(client):
    client.next_poses()
    apply_fault(client.cameras, {"do": "dropout", "body": "uav1", "on": True})
    apply_fault(client.cameras, {"do": "freeze", "body": "uav3", "on": True})
    apply_fault(client.cameras, {"do": "jump", "body": "uav3", "by_m": [1, 0, 0]})
    seen = client.next_poses()
    assert set(seen) == {"aero2", "uav3"} and seen["uav3"].p_n == pytest.approx(P_N[2], abs=1e-6)
    for kind, body in (("dropout", "uav1"), ("freeze", "uav3")):
        apply_fault(client.cameras, {"do": kind, "body": body, "on": False})
    seen = client.next_poses()
    assert seen["uav1"].p_n == pytest.approx(P_N[0], abs=1e-6)
    assert seen["uav3"].p_n == pytest.approx(P_N[2] + [1, 0, 0], abs=1e-6)


def run(rig: NatNetRig, until: float, number: int = 1, faults=()) -> list[tuple[float, natnet.Frame]]:
    """Step the cameras as the process does, on a clock of 4 ms.

    faults: (time [s], fault). Returns (time of sending [s], frame).
    """
    cameras, left, now, waiting = rig.cameras, [], 0.0, list(faults)
    while (due := cameras.due(number)) < until:
        now = max(now, np.ceil(due / 0.004 - 1e-6) * 0.004)
        while waiting and waiting[0][0] <= now:
            apply_fault(cameras, waiting.pop(0)[1])
        if cameras.exposure(number) + cameras.latency_s <= due:
            cameras.enqueue(number, row(truth(cameras.exposure(number))))
            number += 1
        packets = [rig.server.encode(frame, now) for frame in cameras.leaving(now)]
        left += [(now, natnet.decode_frame(packet, (4, 1))) for packet in packets]
    return left


SLOW, QUICK = {"do": "delay", "ms": 200}, {"do": "delay", "ms": 0}


def test_delayed_frames_leave_later_in_order_and_each_once():
    left = run(
        make_rig(),
        2.0,
        faults=[(0.5, SLOW), (1.0, {"do": "dropout", "body": "uav1", "on": True}), (1.5, QUICK)],
    )
    numbers = [frame.number for _, frame in left]
    assert numbers == list(range(1, numbers[-1] + 1)) and numbers[-1] > 350
    for now, frame in left:
        late = now - frame.timestamp_s
        assert 0.01 - 1e-6 <= late <= 0.2141
        assert late >= 0.21 - 1e-6 or not 0.5 < frame.timestamp_s < 1.28
        assert frame.transmit_ticks == pytest.approx(now * 1e7, abs=1)
        if abs(taken := frame.timestamp_s + 0.01 - 1.0) > 0.0041:
            assert frame.bodies[0].tracked == (taken < 0.0), (
                "frames exposed before the dropout still show the body"
            )
        assert frame.bodies[1].position[1] == pytest.approx(P_N[1][0] + 0.1 * frame.timestamp_s, abs=1e-5), (
            "where it was then"
        )
    assert not [now for now, _ in left if 0.504 < now < 0.692], "nothing leaves while the delay begins"
    burst = [now for now, _ in left if 1.5 - 1e-9 <= now < 1.5035]
    assert 30 <= len(burst) <= 40, "what has waited long enough leaves at once"
    assert max(now - frame.timestamp_s for now, frame in left if now > 1.504) < 0.0145


def test_forwarder_drops_delayed_poses_and_recovers_when_the_delay_ends():
    rig = make_rig(0.0003, 0.05)
    receiver = Client(rig).receiver
    forwarder = Forwarder(
        {
            "id": 1,
            "body": "uav1",
            "frame_rate_hz": 180,
            "rate_hz": 60,
            "stale_s": 0.1,
            "origin": None,
            "noise": {"position_m": 0.0003, "rotation_deg": 0.05},
        }
    )
    forwarder.autopilot.armed = True
    sent = []
    for now, frame in run(rig, 8.0, faults=[(1.0, {"do": "delay", "ms": 60}), (2.0, SLOW), (6.0, QUICK)]):
        captured = receiver.receive(natnet.encode_frame(frame, (4, 1)))
        if captured is not None and forwarder.on_frame(captured, now) is not None:
            sent.append(now)
    in_time = [sum(a <= t < b for t in sent) for a, b in ((0.1, 1.0), (1.1, 2.0), (2.01, 6.0), (6.1, 8.0))]
    assert in_time[0] == pytest.approx(54, abs=1) and in_time[1] == pytest.approx(54, abs=1), (
        "a little late is not too late"
    )
    assert in_time[2] <= 1, "a flying vehicle is never given poses of long ago"
    assert in_time[3] == pytest.approx(114, abs=1)
    assert forwarder.counts["stale"] > 600 and forwarder.counts["capture restarts"] == 0
    assert not receiver.counts["repeated"] and not receiver.counts["restarted"]
    assert forwarder.lateness.shifts == 0


JUMP = {"do": "jump", "body": "uav1", "by_m": [1, 0, 0], "yaw_deg": 10}
INVALID = [
    {},
    {"do": "occlude"},
    {"do": {}},
    {"do": "dropout", "body": "uav2", "on": True},
    {"do": "freeze", "body": "uav1"},
    {"do": "dropout", "body": ["uav1"], "on": True},
    {**JUMP, "by_m": [1, 0]},
    {**JUMP, "by_m": [1, 0, float("nan")]},
    {**JUMP, "yaw_deg": float("inf")},
    {**JUMP, "yaw_deg": None},
    {"do": "swap", "bodies": ["uav1", "uav1"], "on": True},
    {"do": "swap", "bodies": ["uav1"], "on": True},
    {"do": "swap", "bodies": ["uav1", "uav3"]},
    {"do": "delay"},
    {"do": "delay", "ms": -1},
    {"do": "delay", "ms": 1e9},
    {"do": "delay", "ms": float("nan")},
]


@pytest.mark.parametrize("fault", INVALID, ids=str)
def test_invalid_fault_is_refused_and_changes_nothing(client, fault):
    with pytest.raises(InputError):
        apply_fault(client.cameras, fault)
    seen = client.next_poses()
    assert [seen[name].p_n for name in NAMES] == [pytest.approx(p, abs=1e-6) for p in P_N]
    assert client.cameras.delay_s == 0.0
