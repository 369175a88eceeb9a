"""Poses, trails, meshes and plots of the page."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fleets import fleet, settings

from arena.geometry import quat_from_euler, quat_rotate
from arena.monitor import poses, vehicle_mesh
from arena.monitor.history import BY_TITLE, QUANTITIES, History, plot
from arena.monitor.trails import Trails

ATTITUDE = np.radians([10.0, -20.0, 35.0])


def test_up_on_the_page_is_up_in_the_room():
    assert poses.world_positions(np.array([[1.0, 2.0, -3.0]])).tolist() == [[2.0, 1.0, 3.0]]


def test_unknown_positions_are_out_of_sight():
    assert poses.world_positions(np.full((1, 3), np.nan))[0, 2] == poses.HIDDEN_M
    assert poses.world_attitudes(np.full((1, 4), np.nan)).shape == (1, 4)


def test_rotors_are_where_the_body_carries_them():
    q_nb = quat_from_euler(ATTITUDE)[None]
    place_b = np.array([0.13, 0.22, -0.02])
    expected_n = np.array([1.0, 2.0, -3.0]) + quat_rotate(q_nb, place_b[None])[0]
    p_w, q_wf = poses.world_positions(np.array([[1.0, 2.0, -3.0]])), poses.world_attitudes(q_nb)
    places, _ = poses.rotor_poses(p_w, q_wf, place_b[None] * (1.0, -1.0, -1.0), np.zeros((1, 1)))
    assert np.allclose(places[0], (expected_n[1], expected_n[0], -expected_n[2]))


def test_faster_rotors_turn_further_and_never_seem_to_turn_back():
    turns = poses.rotor_turns(np.array([[0.0, 0.5, 1.0, np.nan]]), np.array([1.0, -1.0, 1.0, 1.0]))
    assert turns[0, 0] == turns[0, 3] == 0.0
    assert turns[0, 1] < 0.0 < -turns[0, 1] < turns[0, 2] < math.pi / 2


def test_setpoint_without_a_height_is_at_the_vehicles_height():
    found = poses.setpoint_positions(fleet(1, set_p_n=np.array([[2.0, 3.0, np.nan]])))
    assert found.tolist() == [[2.0, 3.0, -1.0]]


def test_no_setpoint_is_drawn_for_a_disarmed_vehicle_or_a_rate_setpoint():
    assert np.isnan(poses.setpoint_positions(fleet(2, armed=(False, None)))).all()
    assert np.isnan(poses.setpoint_positions(fleet(1, set_p_n=np.full((1, 3), np.nan)))).all()


def test_trail_is_made_of_pieces_that_join():
    trails = Trails(1, 2)
    points = [np.array([[float(i), 0.0, -1.0]]) for i in range(4)]
    assert [trails.add(p) for p in points[:3]] == [False, False, True]
    first, rows = trails.piece()
    assert first.shape == (2, 2, 3) and rows.tolist() == [0, 0]
    trails.next_piece()
    trails.add(points[3])
    second, _ = trails.piece()
    assert second[0, 0].tolist() == first[-1, 1].tolist() and trails.number == 1


def test_trail_has_a_gap_where_the_position_is_unknown():
    trails = Trails(2, 10)
    for p in ([0.0, np.nan], [1.0, 1.0], [2.0, 2.0]):
        trails.add(np.array([[x, 0.0, -1.0] for x in p]))
    _, rows = trails.piece()
    assert sorted(rows.tolist()) == [0, 0, 1]


def test_neighbouring_rotors_do_not_touch():
    vehicle = settings(1).vehicles[0]
    places, radius = vehicle_mesh.rotor_places(vehicle), vehicle_mesh.rotor_radius(vehicle)
    apart = min(math.dist(a, b) for i, a in enumerate(places) for b in places[:i])
    assert 0.05 < radius < apart / 2


def test_hull_is_a_binary_gltf_file():
    pytest.importorskip("trimesh")
    assert vehicle_mesh.hull_glb(settings(1).vehicles[0], (255, 0, 0))[:4] == b"glTF"


def test_history_keeps_its_window_and_rate():
    history = History(seconds=2.0, rate_hz=10.0)
    added = [history.add(0.01 * k, fleet(2)) for k in range(500)]
    found = history.of_vehicle(1)
    assert found is not None
    times, states = found
    assert sum(added) == 50 and 20 <= len(times) <= 21 and times[-1] - times[0] <= 2.0 + 1e-9
    assert states.p_n.shape == (len(times), 3) and states.p_n[0, 0] == 1.0
    assert states.modes[0] == "OFFBOARD"


def test_jump_back_in_time_begins_a_new_history():
    history = History()
    history.add(10.0, fleet(1))
    history.add(5.0, fleet(1))
    found = history.of_vehicle(0)
    assert found is not None and found[0].tolist() == [5.0]
    assert History().of_vehicle(0) is None


def lines_of(quantity, times, states):
    """Return the times, the lines and the range of a plot, without the first time, which has unknown values."""
    ago, *lines, ends = plot(quantity, times, states, 10.0)
    return ago, [line[1:] for line in lines], (ends.min(), ends.max())


@pytest.mark.parametrize("quantity", QUANTITIES, ids=lambda q: q.title)
def test_every_quantity_can_be_plotted(quantity):
    data = plot(quantity, np.array([4.0, 5.0]), fleet(2), 10.0)
    assert len(data) == 2 + len(quantity.lines) and len({column.shape for column in data}) == 1
    assert np.isfinite(data[0]).all() and np.isfinite(data[-1]).all()


def test_plots_of_all_times_have_the_same_range_of_time():
    for times in ([5.0], [4.0, 5.0], [0.0, 100.0]):
        ago, _, _ = lines_of(QUANTITIES[0], np.array(times), fleet(len(times)))
        assert (ago[0], ago[-1]) == (-10.0, 0.0) and (np.diff(ago) >= 0.0).all()


def test_height_is_positive_upwards():
    _, lines, _ = lines_of(BY_TITLE["height [m]"], np.array([0.0]), fleet(1))
    assert [line.tolist() for line in lines] == [[1.0]] * 3


def test_noise_does_not_fill_the_plot_and_unknown_values_do_not_matter():
    quantity = BY_TITLE["height [m]"]
    unknown = fleet(2, set_p_n=np.full((2, 3), np.nan))
    _, _, (low, high) = lines_of(quantity, np.array([0.0, 1.0]), unknown)
    assert (low, high) == (1.0 - 0.5 * quantity.span, 1.0 + 0.5 * quantity.span)


def test_range_contains_all_values():
    far = fleet(2, p_n=np.array([[-3.0, 0.0, 0.0], [9.0, 0.0, 0.0]]))
    _, _, ends = lines_of(BY_TITLE["north [m]"], np.array([0.0, 1.0]), far)
    assert ends == (-3.0, 9.0)


def test_planned_paths_are_drawn_up_in_the_room_and_only_in_offboard():
    paths = (np.array([(1.0, 2.0, -3.0), (2.0, 2.0, -3.0), (2.0, 3.0, -1.0)]), np.zeros((0, 3)))
    found = poses.path_segments(paths)
    assert found.tolist() == [[[2, 1, 3], [2, 2, 3]], [[2, 2, 3], [3, 2, 1]]]
    assert (poses.path_segments([])[..., 2] == poses.HIDDEN_M).all()
    assert poses.follows_program(
        fleet(3, modes=("OFFBOARD", "AUTO.LAND", "OFFBOARD"), armed=(True, True, None))
    ) == (
        True,
        False,
        False,
    )
