"""Obstacles: extents, surface, nearest points, distance to a vehicle, and the form in slices."""

from __future__ import annotations

import json

import numpy as np
import pytest

from arena.geometry import matrix_from_quat
from arena.obstacles import Obstacle, gap_to_vehicle_m, obstacles_of

TURNED = (0.2, -0.3, 0.7)
BODIES = [
    Obstacle(name="box", shape="box", size_m=(1.0, 2.0, 0.5), centre_n=(1.0, -2.0, -1.5), rpy_rad=TURNED),
    Obstacle(
        name="pole", shape="cylinder", size_m=(0.4, 0.4, 2.0), centre_n=(0.5, 1.0, -1.2), rpy_rad=TURNED
    ),
    Obstacle(name="ball", shape="sphere", size_m=(0.6, 0.6, 0.6), centre_n=(0.5, 1.0, -1.2), rpy_rad=TURNED),
]
each = pytest.mark.parametrize("body", BODIES, ids=lambda o: o.name)


@each
def test_surface_is_within_the_extents_and_reaches_them(body):
    vertices, faces = body.mesh()
    reach = np.abs(vertices - body.centre_n).max(axis=0)
    assert (reach <= np.array(body.half_extents_n) + 1e-9).all()
    assert reach == pytest.approx(body.half_extents_n, rel=0.02)
    assert faces.min() == 0 and faces.max() == len(vertices) - 1


@each
def test_surface_is_closed_and_has_the_volume_of_the_body(body):
    vertices, faces = body.mesh()
    a, b, c = (vertices[faces[:, k]] - body.centre_n for k in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    length, width, height = body.size_m
    exact = {
        "box": length * width * height,
        "cylinder": np.pi / 4 * length**2 * height,
        "sphere": np.pi / 6 * length**3,
    }
    assert np.abs(volumes).sum() == pytest.approx(exact[body.shape], rel=0.08)
    assert abs(volumes.sum()) == pytest.approx(np.abs(volumes).sum()), "all triangles have the same sense"


@each
def test_rotation_matrix_equals_the_attitude(body):
    assert np.array(body.r_nb) == pytest.approx(matrix_from_quat(body.q_nb), abs=1e-12)


@each
def test_nearest_point_of_a_point_inside_is_the_point(body):
    inside = np.array(body.centre_n) + 0.2 * (np.array(body.r_nb) @ (np.array(body.size_m) / 2))
    assert body.nearest(inside) == pytest.approx(inside)


@each
def test_nearest_point_is_nearer_than_every_vertex(body):
    vertices, _ = body.mesh()
    for p_n in np.random.default_rng(3).uniform(-4, 4, (40, 3)):
        near = body.nearest(p_n)
        assert np.linalg.norm(near - p_n) <= np.linalg.norm(vertices - p_n, axis=1).min() + 1e-9


@each
def test_edges_are_on_the_surface(body):
    for p_n in body.edges().reshape(-1, 3):
        assert body.nearest(p_n) == pytest.approx(p_n, abs=1e-9)


@each
def test_slice_contains_the_whole_obstacle(body):
    assert obstacles_of(json.loads(json.dumps([body.slice()]))) == (body,)


@pytest.mark.parametrize(
    ("start_n", "gap"),
    [((0.0, 0.0, 0.0), 0.2), ((1.0, 0.0, -1.1), 0.1), ((1.0, 0.0, 0.0), 0.0), ((1.0, 0.9, -0.9), 0.1)],
    ids=["beside", "above", "inside", "beside at the top"],
)
def test_gap_between_box_and_vehicle(start_n, gap):
    box = Obstacle(name="box", shape="box", size_m=(1.0, 1.0, 1.0), centre_n=(1.0, 0.0, -0.5))
    assert gap_to_vehicle_m(box, start_n, 0.3, 0.2) == pytest.approx(gap, abs=1e-3)


def test_thin_pole_inside_a_vehicle_has_no_gap():
    pole = Obstacle(name="pole", shape="cylinder", size_m=(0.01, 0.01, 2.0), centre_n=(0.2, 0.1, -1.0))
    assert gap_to_vehicle_m(pole, (0.0, 0.0, 0.0), 0.3, 0.1) == pytest.approx(0.0, abs=1e-6)
