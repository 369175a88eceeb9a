"""Meshes of a vehicle, computed from the positions of its rotors: the hull, and the blades of one rotor.

Axes are those of the body, FLU. All lengths are in metres.
"""

from __future__ import annotations

import importlib
import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.geometry import frd_from_flu
from arena.live_view.settings import VehicleSettings
from arena.monitor.colours import Rgb

Array = NDArray[np.float64]

_HULL: Rgb = (46, 52, 64)
_MOTOR: Rgb = (120, 130, 148)
_NOSE: Rgb = (250, 250, 252)
_DISC_SIDES = 20


def rotor_places(vehicle: VehicleSettings) -> Array:
    """Return the position of each rotor [m] [FLU] (R, 3)."""
    return frd_from_flu(np.array([r.position_b for r in vehicle.rotors], float).reshape(-1, 3))


def rotor_radius(vehicle: VehicleSettings) -> float:
    """Return the radius of the drawn rotors [m], small enough that neighbouring rotors do not touch."""
    places = rotor_places(vehicle)[:, :2]
    if len(places) < 2:
        return 0.4 * vehicle.radius_m
    nearest = min(math.dist(a, b) for a, b in itertools.combinations(places.tolist(), 2))
    return 0.46 * nearest


def hull_glb(vehicle: VehicleSettings, colour: Rgb) -> bytes:
    """Return the hull of a vehicle (arms, motors, roof, nose) as a binary glTF file.

    Front arms and roof have the given colour. A white nose points forward.
    """
    trimesh = _trimesh()

    size = vehicle.radius_m
    height = max(0.35 * vehicle.height_m, 0.1 * size)
    parts = [
        _painted(trimesh.creation.box((0.62 * size, 0.4 * size, height)), _HULL),
        _painted(
            _moved(trimesh.creation.box((0.46 * size, 0.3 * size, 0.5 * height)), (0, 0, 0.7 * height)),
            colour,
        ),
        _painted(_nose(size, height), _NOSE),
    ]
    for place in rotor_places(vehicle):
        arm = trimesh.creation.box((math.hypot(place[0], place[1]), 0.1 * size, 0.08 * size))
        arm.apply_translation((0.5 * math.hypot(place[0], place[1]), 0.0, 0.0))
        arm.apply_transform(
            trimesh.transformations.rotation_matrix(math.atan2(place[1], place[0]), (0, 0, 1))
        )
        parts.append(_painted(arm, colour if place[0] > 0.0 else _HULL))
        motor = trimesh.creation.cylinder(radius=0.075 * size, height=0.16 * size, sections=10)
        parts.append(_painted(_moved(motor, (place[0], place[1], place[2])), _MOTOR))
    data = trimesh.util.concatenate(parts).export(file_type="glb")
    return bytes(data)


def simple_hull_glb(vehicle: VehicleSettings, colour: Rgb) -> bytes:
    """Return a simple hull with few faces, as a binary glTF file: a box, flat arms, and a white nose.

    It has about an eighth of the faces of `hull_glb`.
    """
    trimesh = _trimesh()

    size = vehicle.radius_m
    height = max(0.5 * vehicle.height_m, 0.15 * size)
    tip = np.array([(0.55 * size, 0.0, 0.0)])
    base = np.array([(0.3, 0.14, 0.0), (0.3, -0.14, 0.0), (0.3, 0.0, 0.16)]) * size
    nose = trimesh.Trimesh(np.vstack([tip, base]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    parts = [
        _painted(trimesh.creation.box((0.62 * size, 0.4 * size, height)), colour),
        _painted(nose, _NOSE),
    ]
    for place in rotor_places(vehicle):
        across = (
            0.06 * size * np.array([-place[1], place[0], 0.0]) / max(math.hypot(place[0], place[1]), 1e-6)
        )
        corners = np.array([across, -across, place - across, place + across])
        both_sides = [[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]
        parts.append(_painted(trimesh.Trimesh(corners, both_sides), colour if place[0] > 0.0 else _HULL))
    data = trimesh.util.concatenate(parts).export(file_type="glb")
    return bytes(data)


def flat_blades(radius: float) -> tuple[Array, NDArray[np.uint32]]:
    """Return vertices (4, 3) and faces (2, 3) of a flat propeller with two blades along x. radius: [m]."""
    x, y = radius, 0.1 * radius
    vertices = np.array([(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)])
    return vertices, np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def blades(radius: float) -> tuple[Array, NDArray[np.uint32]]:
    """Return vertices (V, 3) and faces (F, 3) of a propeller with two blades along x. radius: [m]."""
    trimesh = _trimesh()

    one = trimesh.creation.box((2.0 * radius, 0.16 * radius, 0.03 * radius))
    return np.asarray(one.vertices, float), np.asarray(one.faces, np.uint32)


def disc(radius: float) -> tuple[Array, NDArray[np.uint32]]:
    """Return vertices (V, 3) and faces (F, 3) of a flat disc. radius: [m]."""
    angle = np.linspace(0.0, 2.0 * math.pi, _DISC_SIDES, endpoint=False)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(_DISC_SIDES)], axis=1)
    k = np.arange(_DISC_SIDES)
    faces = np.stack([np.full(_DISC_SIDES, _DISC_SIDES), k, (k + 1) % _DISC_SIDES], axis=1)
    return np.vstack([rim, np.zeros((1, 3))]), faces.astype(np.uint32)


def octahedron(radius: float) -> tuple[Array, NDArray[np.uint32]]:
    """Return vertices (6, 3) and faces (8, 3) of an octahedron. radius: [m]."""
    vertices = radius * np.vstack([np.eye(3), -np.eye(3)])
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    return vertices, np.array(faces, np.uint32)


def _nose(size: float, height: float) -> Any:
    trimesh = _trimesh()

    cone = trimesh.creation.cone(radius=0.5 * height + 0.03 * size, height=0.26 * size, sections=12)
    cone.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (0, 1, 0)))
    return _moved(cone, (0.3 * size, 0.0, 0.0))


def _trimesh() -> Any:
    """Import and return the module trimesh as `Any`, because mypy rejects its incomplete type hints."""
    return importlib.import_module("trimesh")


def _moved(mesh: Any, by: tuple[float, float, float]) -> Any:
    mesh.apply_translation(by)
    return mesh


def _painted(mesh: Any, colour: Rgb) -> Any:
    mesh.visual.vertex_colors = np.tile(np.array([*colour, 255], np.uint8), (len(mesh.vertices), 1))
    return mesh
