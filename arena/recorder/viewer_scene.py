"""3D scene for Foxglove: the room, a model of each vehicle, and flown and planned paths. Pure.

The room has a floor, walls and a geofence.

The room stands in the frame `arena`, and each model in the body frame of its vehicle. `viewer_poses` describes these frames.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from foxglove.messages import (
    ArrowPrimitive,
    Color,
    CubePrimitive,
    CylinderPrimitive,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Vector3,
)

from arena.obstacles import Obstacle
from arena.recorder.viewer_poses import ROOT, Triple, duration, point, quaternion, timestamp, vector

TRAIL_S = 20.0
"""Time for which a piece of a path stays visible [s]."""
_ALONG = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
_NORTHWARD = Quaternion(x=0.0, y=0.0, z=math.sqrt(0.5), w=math.sqrt(0.5))
_FLOOR, _WALL, _TILE = (0.55, 0.58, 0.62, 0.35), (0.35, 0.40, 0.48, 0.9), (0.45, 0.48, 0.53, 0.5)
_FENCE, _NORTH = (0.95, 0.55, 0.10, 0.9), (0.80, 0.15, 0.15, 1.0)
_BODY, _ARM, _NAME = (0.30, 0.32, 0.36, 1.0), (0.38, 0.40, 0.44, 1.0), (0.10, 0.45, 0.85, 1.0)
_FRONT, _REAR = (0.90, 0.25, 0.15, 0.75), (0.20, 0.22, 0.26, 0.6)
_PLANNED = (0.98, 0.80, 0.08, 0.9)
_FLOWN, _DESIRED = (0.12, 0.47, 0.71, 0.9), (1.0, 0.50, 0.05, 0.9)
_TILES_M = 1.0
_MAX_TILES = 60
_SPIN_HEIGHT_M = 0.008
_MIN_ROTOR_M = 0.02

Colour = tuple[float, float, float, float]
Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class VehicleShape:
    """Dimensions of a vehicle, read from its profile.

    rotors: position of each rotor [m] [FRD].  rotor_radius_m: radius of the propellers [m].  height_m: height of the vehicle [m].
    """

    rotors: tuple[Triple, ...]
    rotor_radius_m: float
    height_m: float


def shape_of(raw: Mapping[str, Any]) -> VehicleShape:
    """Return the dimensions of a vehicle.

    raw: entry of a vehicle in the configuration (slice) of the recorder.

    Propellers of unknown radius end at the vehicle's radius, and do not overlap.
    """
    rotors = tuple((float(x), float(y), float(z)) for x, y, z in raw["rotors_m"])
    outermost = max((math.hypot(x, y) for x, y, _ in rotors), default=0.0)
    apart = min((math.dist(a, b) for a, b in itertools.combinations(rotors, 2)), default=math.inf)
    given = raw["rotor_radius_m"]
    room = min(max(float(raw["radius_m"]) - outermost, _MIN_ROTOR_M), 0.5 * apart)
    return VehicleShape(
        rotors=rotors,
        rotor_radius_m=room if given is None else float(given),
        height_m=float(raw["height_m"]),
    )


def room_scene(
    size_m: Sequence[float], fence: Box | None, time_s: float, obstacles: Sequence[Obstacle] = ()
) -> SceneUpdate:
    """Return the 3D scene of the room: floor with tiles of 1 m, edges, north arrow, geofence and obstacles.

    size_m: north, east, height [m].  time_s: log time [s].
    fence: smallest and largest north, east and height of the geofence [m]; None without a geofence.
    obstacles: fixed bodies in the room.
    """
    north, east, height = size_m
    room: Box = ((-north / 2, north / 2), (-east / 2, east / 2), (0.0, height))
    entities = [
        _entity(
            "floor",
            ROOT,
            time_s,
            cubes=[_floor(north, east)],
            lines=[_lines(_tiles(north, east), _TILE, 1.0)],
        ),
        _entity("walls", ROOT, time_s, lines=[_lines(_edges(room), _WALL, 2.0)]),
        _entity("north", ROOT, time_s, arrows=[_north_arrow(north)], texts=[_north_text(north)]),
    ]
    if fence is not None:
        entities.append(_entity("geofence", ROOT, time_s, lines=[_lines(_edges(fence), _FENCE, 2.0)]))
    entities += [_obstacle(o, time_s) for o in obstacles]
    return SceneUpdate(entities=entities)


def vehicle_model(name: str, shape: VehicleShape, time_s: float) -> SceneUpdate:
    """Return the 3D model of a vehicle in its body frame: body, arms, propellers (front ones red) and name.

    name: name of the vehicle and of its body frame.  time_s: log time [s].
    """
    hubs = [Point3(x=x, y=-y, z=-z) for x, y, z in shape.rotors]
    span = max((math.hypot(x, y) for x, y, _ in shape.rotors), default=0.2)
    body = CubePrimitive(
        pose=_pose(0.0, 0.0, 0.0),
        size=Vector3(x=0.6 * span, y=0.45 * span, z=0.35 * shape.height_m),
        color=_color(_BODY),
    )
    arms = LinePrimitive(
        type=LinePrimitiveLineType.LineList,
        pose=_pose(0.0, 0.0, 0.0),
        thickness=0.07 * span,
        points=[p for hub in hubs for p in (Point3(x=0.0, y=0.0, z=0.0), hub)],
        color=_color(_ARM),
    )
    model = _entity(
        name,
        name,
        time_s,
        locked=True,
        cubes=[body],
        lines=[arms],
        cylinders=[_propeller(rotor, shape.rotor_radius_m) for rotor in shape.rotors],
        texts=[_name_text(name, shape)],
    )
    return SceneUpdate(entities=[model])


def path_piece(
    name: str, number: int, points: Iterable[Sequence[float]], time_s: float, *, desired: bool
) -> SceneUpdate:
    """Return one piece of a vehicle's path as a 3D line. Viewers remove it after `TRAIL_S` seconds.

    name: name of the vehicle.  number: number of the piece.  points: positions [m] [NED] (3,) each.
    desired: piece of the setpoints' path instead of the flown path.  time_s: log time [s].
    """
    line = LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        pose=_pose(0.0, 0.0, 0.0),
        thickness=2.0,
        scale_invariant=True,
        points=[point(p) for p in points],
        color=_color(_DESIRED if desired else _FLOWN),
    )
    kind = "desired" if desired else "flown"
    entity = _entity(f"{name}/{kind}/{number}", ROOT, time_s, lifetime_s=TRAIL_S, lines=[line])
    return SceneUpdate(entities=[entity])


def planned_path(name: str, points: Iterable[Sequence[float]], time_s: float) -> SceneUpdate:
    """Return the planned path of a vehicle as a 3D line. It replaces the previous planned path.

    name: name of the vehicle.  points: positions [m] [NED] (3,) each; none removes the path.  time_s: log time [s].
    """
    line = LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        pose=_pose(0.0, 0.0, 0.0),
        thickness=2.0,
        scale_invariant=True,
        points=[point(p) for p in points],
        color=_color(_PLANNED),
    )
    return SceneUpdate(entities=[_entity(f"{name}/planned", ROOT, time_s, lines=[line])])


def _entity(
    identity: str,
    frame: str,
    time_s: float,
    *,
    locked: bool = False,
    lifetime_s: float = 0.0,
    **primitives: Any,
) -> SceneEntity:
    """Return an entity (a named object) of the 3D scene.

    locked: it moves with its frame.
    lifetime_s: 0 means until it is replaced [s].
    """
    return SceneEntity(
        timestamp=timestamp(time_s),
        frame_id=frame,
        id=identity,
        lifetime=duration(lifetime_s),
        frame_locked=locked,
        **primitives,
    )


def _color(rgba: Colour) -> Color:
    return Color(r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3])


def _pose(x: float, y: float, z: float, turned: Quaternion = _ALONG) -> Pose:
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=turned)


def _lines(points: list[Point3], colour: Colour, thickness_px: float) -> LinePrimitive:
    """Return a set of separate straight lines.

    points: begin and end of each line.
    """
    return LinePrimitive(
        type=LinePrimitiveLineType.LineList,
        pose=_pose(0.0, 0.0, 0.0),
        thickness=thickness_px,
        scale_invariant=True,
        points=points,
        color=_color(colour),
    )


def _obstacle(obstacle: Obstacle, time_s: float) -> SceneEntity:
    pose = Pose(position=vector(obstacle.centre_n), orientation=quaternion([float(x) for x in obstacle.q_nb]))
    size = Vector3(**dict(zip("xyz", obstacle.size_m, strict=True)))
    red, green, blue = obstacle.rgb
    color = _color((red / 255.0, green / 255.0, blue / 255.0, 1.0))
    name = f"obstacle/{obstacle.name}"
    if obstacle.shape == "box":
        return _entity(name, ROOT, time_s, cubes=[CubePrimitive(pose=pose, size=size, color=color)])
    if obstacle.shape == "sphere":
        return _entity(name, ROOT, time_s, spheres=[SpherePrimitive(pose=pose, size=size, color=color)])
    cylinder = CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=color)
    return _entity(name, ROOT, time_s, cylinders=[cylinder])


def _floor(north: float, east: float) -> CubePrimitive:
    return CubePrimitive(
        pose=_pose(0.0, 0.0, -0.01), size=Vector3(x=east, y=north, z=0.01), color=_color(_FLOOR)
    )


def _tiles(north: float, east: float) -> list[Point3]:
    """Return the start and end points of the lines between the floor tiles."""
    found = []
    for k in range(-min(int(east / 2), _MAX_TILES), min(int(east / 2), _MAX_TILES) + 1):
        found += [Point3(x=k * _TILES_M, y=side * north / 2, z=0.0) for side in (-1, 1)]
    for k in range(-min(int(north / 2), _MAX_TILES), min(int(north / 2), _MAX_TILES) + 1):
        found += [Point3(x=side * east / 2, y=k * _TILES_M, z=0.0) for side in (-1, 1)]
    return found


def _edges(box: Box) -> list[Point3]:
    """Return the start and end points of the twelve edges of a box.

    box: smallest and largest north, east and height [m].
    """
    norths, easts, heights = box
    corners = list(itertools.product(easts, norths, heights))
    pairs = itertools.combinations(corners, 2)
    edges = [pair for pair in pairs if sum(a != b for a, b in zip(*pair, strict=True)) == 1]
    return [Point3(x=x, y=y, z=z) for pair in edges for x, y, z in pair]


def _north_arrow(north: float) -> ArrowPrimitive:
    return ArrowPrimitive(
        pose=_pose(0.0, north / 2, 0.0, _NORTHWARD),
        shaft_length=0.4,
        shaft_diameter=0.05,
        head_length=0.2,
        head_diameter=0.15,
        color=_color(_NORTH),
    )


def _north_text(north: float) -> TextPrimitive:
    return TextPrimitive(
        pose=_pose(0.0, north / 2 + 0.8, 0.1),
        billboard=True,
        font_size=0.3,
        color=_color(_NORTH),
        text="N",
    )


def _name_text(name: str, shape: VehicleShape) -> TextPrimitive:
    return TextPrimitive(
        pose=_pose(0.0, 0.0, shape.height_m + 0.1),
        billboard=True,
        font_size=14.0,
        scale_invariant=True,
        color=_color(_NAME),
        text=name,
    )


def _propeller(rotor: Triple, radius_m: float) -> CylinderPrimitive:
    """Return the disc that represents a propeller.

    rotor: its position [m] [FRD].
    """
    x, y, z = rotor
    return CylinderPrimitive(
        pose=_pose(x, -y, -z + _SPIN_HEIGHT_M),
        size=Vector3(x=2 * radius_m, y=2 * radius_m, z=_SPIN_HEIGHT_M),
        bottom_scale=1.0,
        top_scale=1.0,
        color=_color(_FRONT if x > 0 else _REAR),
    )
