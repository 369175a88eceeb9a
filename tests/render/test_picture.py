"""Content of a picture: vehicles where the camera sees them, faces in the right order, labels that do not overlap."""

from __future__ import annotations

import numpy as np
import pytest

from arena.geometry import matrix_from_quat, quat_from_euler
from arena.obstacles import Obstacle
from arena.render import style
from arena.render.airframe import airframe, default_airframe, mesh
from arena.render.backdrop import Room, grid_step_m
from arena.render.camera import look_at
from arena.render.picture import Body, corners_n, draw_picture, drawing_order, label_places, mesh_of
from arena.render.solids import hiding

ROOM = Room(low=(-3.0, -3.0), high=(3.0, 3.0), height_m=3.0)
SIZE = (640, 360)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def body(p_n=(0.0, 0.0, -1.0), rpy_deg=(0.0, 0.0, 0.0), **more) -> Body:
    given = {
        "colour": (255, 0, 0),
        "ref_n": None,
        "trail_n": np.zeros((0, 3)),
        "label": (),
        "spinning": False,
    }
    return Body(
        airframe=more.pop("frame", default_airframe()),
        p_n=np.array(p_n),
        q_nb=quat_from_euler(np.radians(rpy_deg)),
        **{**given, **more},
    )


def drawn(*bodies: Body, camera=None) -> np.ndarray:
    camera = camera or look_at((-8.0, 0.0, -3.0), (0.0, 0.0, -1.0), SIZE)
    return np.asarray(draw_picture(ROOM, camera, bodies, index=0, heading=()), int)


def centre_of(mask: np.ndarray) -> np.ndarray:
    return np.argwhere(mask).mean(axis=0)[::-1]


def test_vehicle_is_drawn_where_the_camera_projects_it():
    camera = look_at((-8.0, 0.0, -3.0), (0.0, 0.0, -1.0), SIZE)
    for place in ((0.0, 0.0, -1.0), (1.0, -1.5, -2.0), (-2.0, 1.0, -0.5)):
        change = np.abs(drawn(body(place)) - drawn()).sum(axis=2)
        red = change * (drawn(body(place))[..., 0] > 150)
        assert centre_of(red > 60) == pytest.approx(camera.project(place), abs=9)


def test_vehicle_behind_an_obstacle_is_hidden_and_one_before_it_is_not():
    wall = Obstacle(name="wall", shape="box", size_m=(0.2, 4.0, 2.5), centre_n=(0.0, 0.0, -1.25))
    room = Room(low=(-3.0, -3.0), high=(3.0, 3.0), height_m=3.0, obstacles=(wall,))
    camera = look_at((-8.0, 0.0, -2.0), (0.0, 0.0, -1.0), SIZE)

    def red(*bodies):
        picture = np.asarray(draw_picture(room, camera, bodies, index=0, heading=()), int)
        return int(((picture[..., 0] > 120) & (picture[..., 1] < 60)).sum())

    behind, before = body((1.0, 0.5, -1.0)), body((-1.5, -0.5, -1.0))
    assert red(behind) == 0
    assert red(before) > 50 and red(before, behind) == pytest.approx(red(before), rel=0.1)


def test_hiding_obstacle_is_one_between_camera_and_vehicle():
    ball = Obstacle(name="ball", shape="sphere", size_m=(1.0, 1.0, 1.0), centre_n=(0.0, 0.0, -1.0))
    eye = np.array([-5.0, 0.0, -1.0])
    assert hiding((ball,), eye, np.array([2.0, 0.0, -1.0])) == [ball]
    for place in ((-2.0, 0.0, -1.0), (2.0, 3.0, -1.0), (2.0, 1.3, -1.0)):
        assert hiding((ball,), eye, np.array(place)) == []


def test_corners_of_a_turned_vehicle_are_rotated_into_the_room():
    """The front right motor of a vehicle with roll 10, pitch -20, yaw 35 degrees."""
    turned = body((1.0, 2.0, -1.5), (10.0, -20.0, 35.0))
    shape = mesh_of(turned.airframe)
    discs = [k for k, paint in enumerate(shape.paints) if paint == "disc"]
    places = np.stack([corners_n(turned)[shape.corners[k]].mean(axis=0) for k in discs])
    r_nb = matrix_from_quat(quat_from_euler(np.radians([10.0, -20.0, 35.0])))
    rotors = turned.airframe.rotors_b
    reach = np.hypot(*rotors[0, :2])
    expected = turned.p_n + (rotors - (0.0, 0.0, 0.06 * reach)) @ r_nb.T
    assert places == pytest.approx(expected, abs=1e-9)
    # 0.16 m forward and right: turned by 35 degrees, the rotor in front right is southeast of north by 80 degrees.
    way = places[0] - turned.p_n
    assert np.degrees(np.arctan2(way[1], way[0])) == pytest.approx(35 + 45, abs=6)


@pytest.mark.parametrize("count", [3, 4, 6, 8])
def test_airframe_has_one_arm_and_one_propeller_per_rotor(count):
    angles = 2 * np.pi * np.arange(count) / count
    frame = airframe(np.stack([0.3 * np.cos(angles), 0.3 * np.sin(angles), np.zeros(count)], axis=1))
    shape = mesh(frame)
    assert shape.paints.count("disc") == count and len(shape.places_b) == count + 1
    assert frame.disc_m < 0.3 * np.sin(np.pi / count)  # neighbours do not touch


def test_coaxial_rotors_do_not_shrink_the_propellers():
    x8 = airframe([(x, y, z) for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (-0.1, 0.0)])
    assert x8.disc_m == pytest.approx(0.46 * 0.6)


def test_normals_point_outwards():
    shape = mesh(default_airframe())
    for k in range(len(shape.paints)):
        if shape.paints[k] == "body":
            assert shape.normals_b[k] @ shape.centres_b[k] > 0


def test_faces_turned_away_are_not_drawn_and_far_arms_come_first():
    frame = default_airframe()
    shape, camera = mesh(frame), look_at((-5.0, 0.0, -3.0), (0.0, 0.0, -1.0), SIZE)
    order = drawing_order(shape, camera, np.array([0.0, 0.0, -1.0]), np.eye(3))
    top = [k for k in order if shape.paints[k] == "body" and shape.normals_b[k, 2] > 0.9]
    assert top == []  # the lower side, seen from above
    discs = [shape.centres_b[k, 0] for k in order if shape.paints[k] == "disc"]
    assert discs[0] > 0 and discs[-1] < 0  # the camera is in the south: north is far
    for unit in range(1, 5):
        own = [shape.paints[k] for k in order if shape.units[k] == unit]
        assert own[-1] == "blade" and own[-2] == "disc"


def test_propellers_are_behind_the_arms_seen_from_below():
    shape, camera = mesh(default_airframe()), look_at((-1.0, 0.0, 0.0), (0.0, 0.0, -3.0), SIZE)
    order = drawing_order(shape, camera, np.array([0.0, 0.0, -3.0]), np.eye(3))
    own = [shape.paints[k] for k in order if shape.units[k] == 1]
    assert own.index("disc") < min(i for i, paint in enumerate(own) if paint in ("arm", "front"))


def test_nearer_vehicle_covers_the_farther_one():
    near, far = body((-2.0, 0.0, -1.5)), body((2.0, 0.0, -0.5), colour=(0, 255, 0))
    camera = look_at((-8.0, 0.0, -2.5), (-2.0, 0.0, -1.5), SIZE)
    both, alone = drawn(far, near, camera=camera), drawn(near, camera=camera)
    at = np.rint(camera.project((-2.0, 0.0, -1.53))).astype(int)
    assert both[at[1], at[0]] == pytest.approx(alone[at[1], at[0]], abs=12)


def test_shadow_is_on_the_floor_straight_below():
    camera = look_at((-8.0, 0.0, -3.0), (0.0, 0.0, -1.0), SIZE)
    x, y = np.rint(camera.project((1.0, 1.0, 0.0))).astype(int)
    with_vehicle = drawn(body((1.0, 1.0, -2.0), ref_n=None))[y - 2 : y + 3, x - 8 : x - 3].mean()
    assert with_vehicle < 0.8 * drawn()[y - 2 : y + 3, x - 8 : x - 3].mean()


def test_vehicle_behind_the_camera_is_not_drawn():
    assert (drawn(body((-12.0, 0.0, -3.0), spinning=True)) == drawn()).all()


def test_trail_and_setpoint_are_drawn():
    trail = np.stack([np.linspace(-2, 0, 30), np.full(30, -1.0), np.full(30, -1.0)], axis=1)
    change = np.abs(drawn(body((0.0, -1.0, -1.0), trail_n=trail)) - drawn(body((0.0, -1.0, -1.0)))).sum(
        axis=2
    )
    assert (change > 40).sum() > 60
    change = np.abs(drawn(body(ref_n=np.array([0.0, 1.5, -2.0]))) - drawn(body())).sum(axis=2)
    assert (change > 40).sum() > 30


def test_labels_of_vehicles_at_one_place_do_not_overlap():
    camera = look_at((-8.0, 0.0, -3.0), (0.0, 0.0, -1.0), SIZE)
    places = label_places(
        camera, [body(), body((0.0, 0.02, -1.0)), body((0.01, 0.0, -1.01))], [(80.0, 30.0)] * 3
    )
    heights = sorted(y for _, y in places)
    assert np.diff(heights).min() >= 30.0


def test_label_beside_another_one_stays_at_its_vehicle():
    camera = look_at((-8.0, 0.0, -3.0), (0.0, 0.0, -1.0), SIZE)
    alone = label_places(camera, [body((0.0, 2.0, -1.0))], [(80.0, 30.0)])
    assert label_places(camera, [body(), body((0.0, 2.0, -1.0))], [(80.0, 30.0)] * 2)[1:] == alone


def test_name_is_written_above_the_vehicle():
    change = np.abs(drawn(body(label=("uav1", "OFFBOARD"))) - drawn(body())).sum(axis=2)
    x, y = look_at((-8.0, 0.0, -3.0), (0.0, 0.0, -1.0), SIZE).project((0.0, 0.0, -1.0))
    where = np.argwhere(change > 40)
    assert where[:, 0].max() < y and abs(where[:, 1].mean() - x) < 5


@pytest.mark.parametrize("count", [1, 2, 10, 48, 200])
def test_every_vehicle_has_its_own_colour(count):
    assert len(set(style.vehicle_colours(count))) == count


def test_grid_of_a_large_room_is_coarser():
    assert grid_step_m(ROOM) == 1.0
    assert grid_step_m(Room(low=(0.0, 0.0), high=(300.0, 90.0), height_m=None)) == 5.0
    assert grid_step_m(Room(low=(0.0, 0.0), high=(790.0, 90.0), height_m=None)) == 10.0
