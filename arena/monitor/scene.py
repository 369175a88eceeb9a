"""The 3D scene of the live page: room, geofence, vehicles, trails and setpoints, drawn with viser.

Vehicles with the same profile are instances of one mesh, so a picture of many vehicles needs few messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from arena.geometry import world_from_ned
from arena.live_view import FleetSnapshot, Settings, VehicleSettings
from arena.monitor import colours, poses, vehicle_mesh
from arena.monitor.trails import Trails

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]

MANY = 30
"""With more vehicles the scene is simpler: trails are dots, hulls and blades have fewer faces, and there are no shadows or rotor discs."""
_TRAIL_PERIOD_S, _PIECE_STEPS, _PIECES = (0.1, 0.3), (20, 5), (12, 4)  # with few vehicles, with many
_SETPOINT_M, _DOT_M = 0.055, 0.05
_LABEL_ABOVE_M = 0.12


class Scene:
    """3D scene of one arena. Call `update` for every picture.

    server: the viser server.  settings: the arena.
    """

    def __init__(self, server: viser.ViserServer, settings: Settings) -> None:
        self._server, self._scene, self._vehicles = server, server.scene, settings.vehicles
        # A software renderer is slow with an environment map: each pixel of a vehicle would read it.
        server.scene.configure_environment_map(None)
        server.scene.configure_default_lights(cast_shadow=len(settings.vehicles) <= MANY)
        draw_room(server, settings)
        self._groups = [
            _Group(server, rows, settings.vehicles, many=len(settings.vehicles) > MANY)
            for rows in _groups(settings.vehicles)
        ]
        n = len(settings.vehicles)
        many = self._many = n > MANY
        self._trail_period_s, self._most_pieces = _TRAIL_PERIOD_S[many], _PIECES[many]
        self._trails = Trails(n, _PIECE_STEPS[many])
        self._trail_colours = np.array([colours.trail(i) for i in range(n)], np.uint8).reshape(-1, 3)
        self._pieces: dict[int, Any] = {}
        self._next_trail = float("-inf")
        vertices, faces = vehicle_mesh.octahedron(_SETPOINT_M)
        self._setpoints = self._scene.add_batched_meshes_simple(
            "/setpoints",
            vertices,
            faces,
            batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (n, 1)),
            batched_positions=np.tile((0.0, 0.0, poses.HIDDEN_M), (n, 1)),
            batched_colors=colours.SETPOINT,
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
            lod="off",
        )
        self._leads = self._scene.add_line_segments(
            "/leads",
            np.full((n, 2, 3), poses.HIDDEN_M),
            colours.SETPOINT,
            thickness=1.5,
            thickness_units="screen",
        )
        self._labels: list[Any] = [None] * n  # None: no label, because browsers draw invisible labels, too
        self._label_texts = [""] * n
        self._drawn_paths: tuple[Sequence[Array], tuple[bool, ...]] = ((), ())

    def update(
        self, fleet: FleetSnapshot, time_s: float, labels: Sequence[str], paths: Sequence[Array] = ()
    ) -> None:
        """Draw one picture of the 3D scene.

        time_s: time of the run [s].  labels: text beside each vehicle; "" hides it.  paths: planned paths [m] [NED] (k, 3) each.
        """
        p_w, q_wf = poses.world_positions(fleet.p_n), poses.world_attitudes(fleet.q_nb)
        set_n = poses.setpoint_positions(fleet)
        set_w = poses.world_positions(set_n)
        with self._server.atomic():
            for group in self._groups:
                group.update(p_w, q_wf, fleet.motors)
            self._setpoints.batched_positions = set_w.astype(np.float32)
            ends = np.where(np.isfinite(set_n[:, :1]), p_w, set_w)
            self._leads.points = np.stack([ends, set_w], axis=1).astype(np.float32)
            self._update_labels(p_w, labels)
            self._update_trails(fleet.p_n, time_s)
            self._update_paths(paths, poses.follows_program(fleet))

    def _update_paths(self, paths: Sequence[Array], shown: tuple[bool, ...]) -> None:
        """Draw the planned paths again, if a path or its visibility has changed."""
        if paths is self._drawn_paths[0] and shown == self._drawn_paths[1]:
            return
        self._drawn_paths = (paths, shown)
        points = poses.path_segments([p for p, show in zip(paths, shown, strict=False) if show])
        self._scene.add_line_segments(
            "/paths", points.astype(np.float32), colours.PATH, thickness=2.0, thickness_units="screen"
        )

    def _update_labels(self, p_w: Array, labels: Sequence[str]) -> None:
        for i, (text, old) in enumerate(zip(labels, self._label_texts, strict=True)):
            if text != old:
                self._label_texts[i] = text
                self._set_label(i, text)
            if text:
                above = self._vehicles[i].height_m + _LABEL_ABOVE_M
                self._labels[i].position = (p_w[i, 0], p_w[i, 1], p_w[i, 2] + above)

    def _set_label(self, i: int, text: str) -> None:
        """Set the text of a vehicle's label. An empty text removes the label."""
        label = self._labels[i]
        if text and label is not None:
            label.text = text
        elif text:
            self._labels[i] = self._scene.add_label(
                f"/labels/{self._vehicles[i].name}",
                text,
                anchor="bottom-center",
                font_screen_scale=0.8,
                depth_test=False,
            )
        elif label is not None:
            label.remove()
            self._labels[i] = None

    def _update_trails(self, p_n: Array, time_s: float) -> None:
        if time_s < self._next_trail and time_s > self._next_trail - 2.0 * self._trail_period_s:
            return
        self._next_trail = time_s + self._trail_period_s
        is_full = self._trails.add(p_n)
        points, rows = self._trails.piece()
        if len(points):
            self._draw_piece(points, rows)
        if is_full:
            self._trails.next_piece()
            if (old := self._pieces.pop(self._trails.number - self._most_pieces, None)) is not None:
                old.remove()

    def _draw_piece(self, points: Array, rows: NDArray[np.int_]) -> None:
        if self._many:
            self._pieces[self._trails.number] = self._scene.add_point_cloud(
                f"/trails/{self._trails.number}",
                points[:, 1],
                self._trail_colours[rows],
                point_size=_DOT_M,
                point_shape="circle",
                point_shading="flat",
                precision="float32",
            )
            return
        tints = np.repeat(self._trail_colours[rows][:, None, :], 2, axis=1)
        number = self._trails.number
        self._pieces[number] = self._scene.add_line_segments(
            f"/trails/{number}", points.astype(np.float32), tints, thickness=2.0, thickness_units="screen"
        )


class _Group:
    """Drawn vehicles that share one mesh, because they have the same profile and the same kind, such as real.

    rows: their indices.  many: draw them simply, because they are small in a picture of many vehicles.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        rows: Sequence[int],
        vehicles: Sequence[VehicleSettings],
        *,
        many: bool,
    ) -> None:
        first = vehicles[rows[0]]
        name = f"/vehicles/{first.kind}-{first.profile}"
        self._rows = np.array(rows)
        self._places = vehicle_mesh.rotor_places(first)
        self._directions = np.array([-1.0 if r.clockwise else 1.0 for r in first.rotors])
        count = len(rows) * len(first.rotors)
        self._angles = np.zeros((len(rows), len(first.rotors)))
        level = np.tile((1.0, 0.0, 0.0, 0.0), (count, 1))
        hidden = np.tile((0.0, 0.0, poses.HIDDEN_M), (count, 1))
        radius = vehicle_mesh.rotor_radius(first)
        scene = server.scene
        self._hulls = scene.add_batched_glb(
            f"{name}/hull",
            (vehicle_mesh.simple_hull_glb if many else vehicle_mesh.hull_glb)(
                first, colours.KINDS[first.kind]
            ),
            batched_wxyzs=level[: len(rows)],
            batched_positions=hidden[: len(rows)],
            cast_shadow=not many,
            receive_shadow=not many,
            lod="off",
        )
        vertices, faces = vehicle_mesh.flat_blades(radius) if many else vehicle_mesh.blades(radius)
        blades = scene.add_batched_meshes_simple(
            f"{name}/blades",
            vertices,
            faces,
            batched_wxyzs=level,
            batched_positions=hidden,
            batched_colors=(214, 222, 235),
            side="double" if many else "front",
            cast_shadow=False,
            receive_shadow=False,
            lod="off",
        )
        self._rotors: list[Any] = [blades]
        if many:
            return
        vertices, faces = vehicle_mesh.disc(radius)
        discs = scene.add_batched_meshes_simple(
            f"{name}/discs",
            vertices,
            faces,
            batched_wxyzs=level,
            batched_positions=hidden,
            batched_colors=colours.KINDS[first.kind],
            opacity=0.22,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            lod="off",
        )
        self._rotors.append(discs)

    def update(self, p_w: Array, q_wf: Array, motors: Array) -> None:
        rows, rotors = self._rows, len(self._places)
        self._hulls.batched_positions = p_w[rows].astype(np.float32)
        self._hulls.batched_wxyzs = q_wf[rows].astype(np.float32)
        self._angles += poses.rotor_turns(motors[rows, :rotors], self._directions)
        places, attitudes = poses.rotor_poses(p_w[rows], q_wf[rows], self._places, self._angles)
        for handle in self._rotors:
            handle.batched_positions = places.astype(np.float32)
            handle.batched_wxyzs = attitudes.astype(np.float32)


def _groups(vehicles: Sequence[VehicleSettings]) -> list[list[int]]:
    found: dict[tuple[Any, ...], list[int]] = {}
    for i, v in enumerate(vehicles):
        found.setdefault((v.kind, v.profile, v.rotors, v.radius_m), []).append(i)
    return list(found.values())


def draw_room(server: viser.ViserServer, settings: Settings) -> None:
    """Draw the room: floor, edges of the walls, axes, geofence and obstacles."""
    north, east, up = settings.size_m
    scene = server.scene
    scene.add_grid(
        "/room/floor",
        width=east,
        height=north,
        cell_size=0.5 if max(north, east) <= 20.0 else 1.0,
        section_size=1.0 if max(north, east) <= 20.0 else 5.0,
        cell_color=colours.GRID,
        section_color=colours.SECTION,
        cell_thickness=1.0,
        section_thickness=1.4,
        plane_color=colours.FLOOR,
        plane_opacity=1.0,
        shadow_opacity=0.35,
        fade_distance=400.0,
    )
    scene.add_line_segments(
        "/room/walls", _box(north, east, 0.0, up), colours.ROOM, thickness=1.5, thickness_units="screen"
    )
    middle = {
        "north": (0.0, 0.5 * north),
        "south": (0.0, -0.5 * north),
        "east": (0.5 * east, 0.0),
        "west": (-0.5 * east, 0.0),
    }
    for word, (x, y) in middle.items():
        out = 1.06
        scene.add_label(
            f"/room/{word}",
            word,
            position=(out * x, out * y, 0.0),
            anchor="center-center",
            font_screen_scale=0.75,
        )
    if (fence := settings.fence) is not None:
        (south, to_north), (west, to_east) = fence.north, fence.east
        edges = _box(to_north - south, to_east - west, 0.0, fence.up)
        edges += np.array((0.5 * (west + to_east), 0.5 * (south + to_north), 0.0))
        scene.add_line_segments("/room/fence", edges, colours.FENCE, thickness=1.5, thickness_units="screen")
    for one in settings.obstacles:
        vertices, faces = one.mesh()
        scene.add_mesh_simple(
            f"/room/obstacles/{one.name}",
            world_from_ned(vertices).astype(np.float32),
            faces.astype(np.uint32),
            color=one.rgb,
            flat_shading=one.shape == "box",
            side="double",
        )


def _box(north: float, east: float, low: float, high: float) -> Array:
    """Return the 12 edges of a box around the origin [m] [world axes] (12, 2, 3)."""
    x, y = 0.5 * east, 0.5 * north
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    edges = []
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        edges += [((ax, ay, z), (bx, by, z)) for z in (low, high)]
        edges.append(((ax, ay, low), (ax, ay, high)))
    return np.array(edges, float)
