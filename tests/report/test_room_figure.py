"""The room in the map of a report: geofence and obstacles where they are."""

from __future__ import annotations

import numpy as np
import pytest

from arena.obstacles import Obstacle
from arena.report.room_figure import room_3d

FENCE = {"north": [-3, 2], "east": [-1.5, 1], "up": 2.5}
SHELF = Obstacle(
    name="shelf", shape="box", size_m=(1.0, 0.4, 2.0), centre_n=(2.0, -1.0, -1.0), colour="#c0703a"
)


def test_room_without_fence_and_obstacles_has_edges_and_floor():
    assert [t.get("name") for t in room_3d((7, 4, 3), {})] == ["room", None]


def test_fence_is_a_box_of_east_north_and_height():
    (fence,) = [t for t in room_3d((7, 4, 3), {"fence": FENCE}) if t.get("name") == "geofence"]
    ends = [(min(v), max(v)) for v in ([x for x in fence[a] if x is not None] for a in "xyz")]
    assert ends == [(-1.5, 1), (-3, 2), (0.0, 2.5)]


def test_obstacle_is_a_mesh_in_east_north_and_height():
    (shelf,) = [t for t in room_3d((7, 4, 3), {"obstacles": [SHELF.slice()]}) if t.get("name") == "shelf"]
    points = np.stack([shelf[a] for a in "xyz"], axis=1)
    assert points.min(axis=0) == pytest.approx([-1.2, 1.5, 0.0])
    assert points.max(axis=0) == pytest.approx([-0.8, 2.5, 2.0])
    assert shelf["color"] == "#c0703a"
