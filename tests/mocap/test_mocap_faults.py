"""The motion capture, spoiled on purpose; read by our receiver and believed, or not, by the forwarder."""

from __future__ import annotations

import numpy as np
import pytest

from arena.errors import InputError
from arena.geometry import quat_conj, quat_from_euler, quat_multiply, quat_rotate
from arena.mocap.client.natnet import NatNetReceiver
from arena.mocap.emulator.core import Emulator
from arena.mocap.emulator.fault_injection import spoil
from arena.pose_forwarder.forwarder import Forwarder
from arena.wire import natnet
from arena.wire.truth_page import Truth

HERE = ("127.61.0.1", 4000)
NAMES = ["uav1", "aero2", "uav3"]
P_N = np.array([[1.25, -0.5, -1.75], [-2.0, 3.0, -0.5], [0.5, 0.25, -2.25]])
Q_NB = quat_from_euler(np.radians([[10.0, -20.0, 35.0], [-15.0, 5.0, 100.0], [25.0, 30.0, -160.0]]))


def cameras(**changes) -> Emulator:
    return Emulator(
        {
            "version": "4.1",
            "rate_hz": 180,
            "latency_ms": 10,
            "noise": {"position_m": 0.0, "rotation_deg": 0.0},
            "seed": 1,
            "transport": "multicast",
            "data_port": 1511,
            "group": "239.255.42.99",
            "bodies": [{"name": n, "streaming_id": 10 + i, "index": 2 - i} for i, n in enumerate(NAMES)],
            **changes,
        }
    )


def truth(time_s: float = 0.0) -> Truth:
    """Rows of the page are in another order than the bodies. They drift, so that no pose is the last one's."""
    z = np.zeros((3, 3))
    p_n = P_N[::-1] + np.array([0.1 * time_s, 0.0, 0.0])
    return Truth(
        time_s=time_s, p_n=p_n, q_nb=Q_NB[::-1], v_n=z, omega_b=z, accel_b=z, motors=np.zeros((3, 4))
    )


class Eyes:
    """Our receiver behind an emulator: what it makes of the packets."""

    def __init__(self, emulator: Emulator) -> None:
        self.emulator, self.receiver, self.number = emulator, NatNetReceiver(NAMES), 0
        for request in (natnet.CONNECT, natnet.REQUEST_MODELDEF):
            self.receiver.hear(emulator.hear(natnet.packet(request), HERE, 0.0))

    def look(self):
        """{body: Pose} of one more frame, without those that are not tracked."""
        self.number += 1
        frame = self.receiver.hear(self.emulator.frame(self.number, truth()))
        return {p.body: p for p in frame.poses}


@pytest.fixture
def eyes():
    return Eyes(cameras())


def test_unspoiled_each_body_is_where_it_is(eyes):
    seen = eyes.look()
    for i, name in enumerate(NAMES):
        assert seen[name].p_n == pytest.approx(P_N[i], abs=1e-6)
        assert abs(np.dot(seen[name].q_nb, Q_NB[i])) == pytest.approx(1.0, abs=1e-9)


def test_a_jump_is_an_offset_in_ned_and_a_yaw_to_the_right_of_one_body(eyes):
    told = spoil(eyes.emulator, {"do": "jump", "body": "aero2", "by_m": [1, -0.5, 0.25], "yaw_deg": 40})
    assert told == "aero2 is seen 1 -0.5 0.25 m and 40 deg off"
    seen = eyes.look()
    assert np.subtract(seen["aero2"].p_n, P_N[1]) == pytest.approx([1, -0.5, 0.25], abs=1e-6)
    turn_n = quat_multiply(np.array(seen["aero2"].q_nb), quat_conj(Q_NB[1]))
    assert quat_rotate(turn_n, [1.0, 0.0, 0.0]) == pytest.approx(
        [np.cos(np.radians(40)), np.sin(np.radians(40)), 0.0], abs=1e-6
    )
    assert quat_rotate(turn_n, [0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert seen["uav1"].p_n == pytest.approx(P_N[0], abs=1e-6)
    spoil(eyes.emulator, {"do": "jump", "body": "aero2", "by_m": [0, 2, 0]})
    assert np.subtract(eyes.look()["aero2"].p_n, P_N[1]) == pytest.approx([0, 2, 0], abs=1e-6), (
        "from where it is, not further"
    )
    assert (
        spoil(eyes.emulator, {"do": "jump", "body": "aero2", "by_m": [0, 0, 0]})
        == "aero2 is seen where it is"
    )
    back = eyes.look()["aero2"]
    assert back.p_n == pytest.approx(P_N[1], abs=1e-6) and abs(np.dot(back.q_nb, Q_NB[1])) == pytest.approx(
        1.0, abs=1e-9
    )


def test_two_swapped_bodies_have_each_others_pose_and_get_their_own_back(eyes):
    told = spoil(eyes.emulator, {"do": "swap", "bodies": ["uav1", "uav3"], "on": True})
    assert told == "uav1 and uav3 are taken for each other"
    seen = eyes.look()
    assert seen["uav1"].p_n == pytest.approx(P_N[2], abs=1e-6) and seen["uav3"].p_n == pytest.approx(
        P_N[0], abs=1e-6
    )
    assert abs(np.dot(seen["uav1"].q_nb, Q_NB[2])) == pytest.approx(1.0, abs=1e-9)
    assert seen["aero2"].p_n == pytest.approx(P_N[1], abs=1e-6)
    spoil(eyes.emulator, {"do": "swap", "bodies": ["uav1", "uav3"], "on": True})
    assert eyes.look()["uav1"].p_n == pytest.approx(P_N[2], abs=1e-6), "said twice, swapped once"
    spoil(eyes.emulator, {"do": "swap", "bodies": ["uav3", "uav1"], "on": False})
    assert eyes.look()["uav1"].p_n == pytest.approx(P_N[0], abs=1e-6)


def test_a_dropout_and_a_frozen_pose_are_of_one_body_and_end(eyes):
    eyes.look()
    spoil(eyes.emulator, {"do": "dropout", "body": "uav1", "on": True})
    spoil(eyes.emulator, {"do": "freeze", "body": "uav3", "on": True})
    spoil(eyes.emulator, {"do": "jump", "body": "uav3", "by_m": [1, 0, 0]})
    seen = eyes.look()
    assert set(seen) == {"aero2", "uav3"} and seen["uav3"].p_n == pytest.approx(P_N[2], abs=1e-6)
    for kind, body in (("dropout", "uav1"), ("freeze", "uav3")):
        spoil(eyes.emulator, {"do": kind, "body": body, "on": False})
    seen = eyes.look()
    assert seen["uav1"].p_n == pytest.approx(P_N[0], abs=1e-6)
    assert seen["uav3"].p_n == pytest.approx(P_N[2] + [1, 0, 0], abs=1e-6)


def run(emulator: Emulator, until: float, number: int = 1, faults=()) -> list[tuple[float, natnet.Frame]]:
    """As the shell does it, on a clock of 4 ms. faults: (time [s], fault). -> (when it left, frame)."""
    left, now, waiting = [], 0.0, list(faults)
    while (due := emulator.due(number)) < until:
        now = max(now, np.ceil(due / 0.004 - 1e-6) * 0.004)
        while waiting and waiting[0][0] <= now:
            spoil(emulator, waiting.pop(0)[1])
        if emulator.exposure(number) + emulator.latency_s <= due:
            emulator.take(number, truth(emulator.exposure(number)))
            number += 1
        left += [(now, natnet.decode_frame(packet, (4, 1))) for packet in emulator.leaving(now)]
    return left


SLOW, QUICK = {"do": "delay", "ms": 200}, {"do": "delay", "ms": 0}


def test_delayed_frames_leave_later_in_order_each_once_and_show_what_was_exposed():
    left = run(
        cameras(),
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
                "what was seen before the dropout still shows the body"
            )
        assert frame.bodies[1].position[1] == pytest.approx(P_N[1][0] + 0.1 * frame.timestamp_s, abs=1e-5), (
            "where it was then"
        )
    assert not [now for now, _ in left if 0.504 < now < 0.692], "nothing leaves while the delay begins"
    burst = [now for now, _ in left if 1.5 - 1e-9 <= now < 1.5035]
    assert 30 <= len(burst) <= 40, "what has waited long enough leaves at once"
    assert max(now - frame.timestamp_s for now, frame in left if now > 1.504) < 0.0145


def test_the_forwarder_takes_delayed_poses_for_what_they_are_and_their_end_for_the_end():
    emulator = cameras(noise={"position_m": 0.0003, "rotation_deg": 0.05})
    receiver = Eyes(emulator).receiver
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
    for now, frame in run(
        emulator, 8.0, faults=[(1.0, {"do": "delay", "ms": 60}), (2.0, SLOW), (6.0, QUICK)]
    ):
        captured = receiver.hear(natnet.encode_frame(frame, (4, 1)))
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


JUMP = {"do": "jump", "body": "uav1", "by_m": [1, 0, 0], "yaw_deg": 10}
SENSELESS = [
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


@pytest.mark.parametrize("fault", SENSELESS, ids=str)
def test_a_fault_that_makes_no_sense_is_refused_and_changes_nothing(eyes, fault):
    with pytest.raises(InputError):
        spoil(eyes.emulator, fault)
    seen = eyes.look()
    assert [seen[name].p_n for name in NAMES] == [pytest.approx(p, abs=1e-6) for p in P_N]
    assert eyes.emulator.delay_s == 0.0
