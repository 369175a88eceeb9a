"""Picture of a film: the room with the vehicles, their shadows, trails, setpoints and names.

Pictures are drawn at SUPERSAMPLING times their size and then reduced, which smooths all edges. Texts are drawn afterwards.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageChops, ImageDraw, ImageFilter

from arena.geometry import Array, matrix_from_quat
from arena.render import style
from arena.render.airframe import Airframe, Mesh, mesh
from arena.render.backdrop import Room, backdrop, line
from arena.render.camera import NEAR_M, Camera
from arena.render.solids import draw_obstacles, hiding

SUPERSAMPLING = 2
_CASTS_SHADOW = ("disc", "body", "arm", "front")
_LIGHT = np.array([-0.35, -0.30, -0.89])  # direction to the lamp [NED]: above, from the southwest
_AMBIENT = 0.45
_SHADOW_STRENGTH = 0.55
_GLOW_BELOW_PX = 60.0  # vehicles smaller than this get a light, so that they are visible
_BLADE_STEP_RAD = 2.1  # turn of the propellers between two pictures


@dataclass(frozen=True, kw_only=True)
class Body:
    """State of one vehicle in one picture of a film.

    p_n: position [m] [NED] (3,).  q_nb: attitude wxyz (4,).  ref_n: position reference [m] [NED] (3,); None if there is none.
    trail_n: earlier positions, oldest first [m] [NED] (k, 3).  label: lines of text.  spinning: propellers turn.
    outdated: the log has a gap, so the vehicle is drawn grey.
    """

    airframe: Airframe
    colour: style.Colour
    p_n: Array
    q_nb: Array
    ref_n: Array | None
    trail_n: Array
    label: Sequence[str]
    spinning: bool
    outdated: bool = False


def draw_picture(
    room: Room, camera: Camera, bodies: Sequence[Body], *, index: int, heading: Sequence[str]
) -> Image.Image:
    """Draw one picture of a film, in the size of the camera's picture.

    index: number of the picture, from which the angles of the propellers are made.  heading: lines at the top left.
    """
    large, line_px = _scaled(camera), SUPERSAMPLING * max(camera.height / 720.0, 0.6)
    empty, floor = _room(room, large, line_px)
    picture = empty.copy()
    _shadows(picture, floor, large, bodies)
    draw = ImageDraw.Draw(picture, "RGBA")
    draw_obstacles(draw, large, room.obstacles, line_px)
    for body in bodies:
        _trail(draw, large, body, line_px)
    for body in bodies:
        _setpoint(draw, large, body, line_px, drop=len(bodies) <= MAX_LABELS)
    ordered = sorted(bodies, key=lambda b: -float(large.depth(b.p_n)))
    in_front = [hiding(room.obstacles, large.eye, body.p_n) for body in ordered]
    for body, before in zip(ordered, in_front, strict=True):
        if before:
            _vehicle(picture, draw, large, body, index)
            draw_obstacles(draw, large, before, line_px)
    for body, before in zip(ordered, in_front, strict=True):
        if not before:
            _vehicle(picture, draw, large, body, index)
    picture = picture.reduce(SUPERSAMPLING)
    _texts(picture, camera, bodies, heading)
    return picture


MAX_LABELS = 16
"""Names are drawn for at most this number of vehicles."""


def _scaled(camera: Camera) -> Camera:
    return Camera(
        eye=camera.eye,
        axes=camera.axes,
        width=SUPERSAMPLING * camera.width,
        height=SUPERSAMPLING * camera.height,
    )


_rooms: dict[bytes, tuple[Image.Image, Image.Image]] = {}


def _room(room: Room, camera: Camera, line_px: float) -> tuple[Image.Image, Image.Image]:
    """Return the picture of the empty room and the mask of its floor.

    The last result is cached for cameras that do not move.
    """
    key = repr((room, camera.width, camera.height)).encode() + camera.eye.tobytes() + camera.axes.tobytes()
    if key not in _rooms:
        _rooms.clear()
        _rooms[key] = backdrop(room, camera, line_px)
    return _rooms[key]


@functools.cache
def _mesh(rotors: bytes, disc_m: float, below_m: float) -> Mesh:
    return mesh(Airframe(rotors_b=np.frombuffer(rotors).reshape(-1, 3), disc_m=disc_m, below_m=below_m))


def mesh_of(frame: Airframe) -> Mesh:
    """Return the 3D model of an airframe. Equal airframes share one model."""
    return _mesh(np.ascontiguousarray(frame.rotors_b).tobytes(), frame.disc_m, frame.below_m)


def corners_n(body: Body) -> Array:
    """Return the corners of all faces of a vehicle [m] [NED] (k, 3), in the order of its 3D model."""
    return np.asarray(body.p_n + mesh_of(body.airframe).points_b @ matrix_from_quat(body.q_nb).T)


def _shadows(picture: Image.Image, floor: Image.Image, camera: Camera, bodies: Sequence[Body]) -> None:
    """Draw dark shapes on the floor straight below the vehicles. They show the horizontal positions."""
    reduced = 4
    mask = Image.new("L", (picture.width // reduced, picture.height // reduced))
    draw = ImageDraw.Draw(mask)
    for body in bodies:
        shape, points = mesh_of(body.airframe), corners_n(body)
        points[:, 2] = 0.0
        if (camera.depth(points) <= NEAR_M).any():
            continue
        pixels = camera.project(points) / reduced
        for k, corner in enumerate(shape.corners):
            if shape.paints[k] in _CASTS_SHADOW:
                draw.polygon(pixels[corner].ravel().tolist(), fill=150 if shape.paints[k] == "disc" else 255)
    box = mask.getbbox()
    if box is None:
        return
    soft = 2.0 * picture.height / 1440
    mask = mask.filter(ImageFilter.GaussianBlur(soft))
    edge = round(4 * soft)
    box = (
        max(box[0] - edge, 0),
        max(box[1] - edge, 0),
        min(box[2] + edge, mask.width),
        min(box[3] + edge, mask.height),
    )
    whole = (box[0] * reduced, box[1] * reduced, box[2] * reduced, box[3] * reduced)
    part = mask.crop(box).point(lambda v: round(_SHADOW_STRENGTH * v))
    part = part.resize((whole[2] - whole[0], whole[3] - whole[1]), Image.Resampling.BILINEAR)
    part = ImageChops.multiply(part, floor.crop(whole))
    picture.paste(style.SHADOW, whole, part)


def _trail(draw: ImageDraw.ImageDraw, camera: Camera, body: Body, line_px: float) -> None:
    """Draw the flown path behind a vehicle. Older parts are thinner and darker.

    Points that fall on nearly the same pixel are left out.
    """
    points = body.trail_n[camera.depth(body.trail_n) > NEAR_M]
    if len(points) < 2:
        return
    pixels = camera.project(points)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pixels, axis=0).T))])
    kept = np.unique(np.floor(way / (1.5 * line_px)), return_index=True)[1]
    share = (kept / (len(points) - 1)).tolist()
    ends = pixels[kept].tolist()
    for (x0, y0), (x1, y1), age in zip(ends[:-1], ends[1:], share[1:], strict=True):
        colour = style.mixed(style.FLOOR, body.colour, 0.25 + 0.75 * age)
        draw.line((x0, y0, x1, y1), fill=colour, width=max(1, round(line_px * (1.0 + 1.2 * age))))


def _setpoint(draw: ImageDraw.ImageDraw, camera: Camera, body: Body, line_px: float, *, drop: bool) -> None:
    """Draw a ring with a cross at the position setpoint, and a line from the vehicle to it.

    drop: also draw a line from the vehicle to the floor.
    """
    if drop and camera.depth(body.p_n) > NEAR_M:
        line(draw, camera, np.stack([body.p_n, body.p_n * (1, 1, 0)]), (*body.colour, 90), 0.8 * line_px)
    if body.ref_n is None or camera.depth(body.ref_n) <= NEAR_M or not drop:
        return
    x, y = camera.project(body.ref_n)
    r = float(np.clip(0.09 * camera.pixels_per_metre(body.ref_n), 3 * line_px, 8 * line_px))
    colour = (*style.mixed(body.colour, style.TEXT, 0.5), 210)
    line(draw, camera, np.stack([body.p_n, body.ref_n]), (*colour[:3], 130), 0.8 * line_px)
    draw.ellipse((x - r, y - r, x + r, y + r), outline=colour, width=max(1, round(1.2 * line_px)))
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        ends = (x + r * dx, y + r * dy, x + 1.7 * r * dx, y + 1.7 * r * dy)
        draw.line(ends, fill=colour, width=max(1, round(1.2 * line_px)))


def _vehicle(picture: Image.Image, draw: ImageDraw.ImageDraw, camera: Camera, body: Body, index: int) -> None:
    """Draw the faces of a vehicle, the farthest face first."""
    if camera.depth(body.p_n) <= body.airframe.radius_m + NEAR_M:
        return
    colour = (150, 154, 162) if body.outdated else body.colour
    size_px = 2 * body.airframe.radius_m * camera.pixels_per_metre(body.p_n)
    if body.spinning and size_px < _GLOW_BELOW_PX * SUPERSAMPLING:
        _glow(picture, camera, body, size_px, colour)
    shape = mesh_of(body.airframe)
    rotation = matrix_from_quat(body.q_nb)
    points_b = _turned(shape, index) if body.spinning else shape.points_b
    pixels = camera.project(body.p_n + points_b @ rotation.T)
    colours = _face_colours(shape, rotation, colour)
    for k in drawing_order(shape, camera, body.p_n, rotation):
        paint, corners = shape.paints[k], pixels[shape.corners[k]].ravel().tolist()
        if paint == "disc":
            draw.polygon(corners, fill=(*colour, 95 if body.spinning else 45), outline=(*colour, 200))
        elif paint == "blade":
            draw.polygon(corners, fill=(*style.BLADE, 110 if body.spinning else 220))
        else:
            draw.polygon(corners, fill=colours[k])


def _face_colours(shape: Mesh, rotation: Array, colour: style.Colour) -> list[style.Colour]:
    """Return the colour of each face of a vehicle, as lit by the lamp of the room.

    rotation: body to NED (3, 3).
    colour: colour of the vehicle.
    """
    lit = np.clip((shape.normals_b @ rotation.T) @ _LIGHT, 0.0, 1.0)
    full = np.array([style.paint_colour(paint, colour) for paint in shape.paints])
    shaded = np.rint(full * (_AMBIENT + (1.0 - _AMBIENT) * lit)[:, None]).astype(int)
    return [(r, g, b) for r, g, b in shaded.tolist()]


def drawing_order(shape: Mesh, camera: Camera, p_n: Array, rotation: Array) -> list[int]:
    """Return the indices of a vehicle's visible faces, the farthest face first.

    p_n: position [m] [NED] (3,).  rotation: body to NED (3, 3).

    The units (body, arms with motor and propeller) are ordered by the distance of their places. Within a unit, the higher
    faces come last if the camera is above the vehicle's plane, else first. Faces of one level are ordered by distance.
    """
    to_eye_b = (camera.eye - p_n) @ rotation - shape.centres_b
    visible = shape.two_sided | ((shape.normals_b * to_eye_b).sum(axis=1) > 0.0)
    unit_depth = np.rint(-camera.depth(p_n + shape.places_b @ rotation.T) * 1e6)[shape.units]
    above = ((camera.eye - p_n) @ rotation)[2] < 0.0
    levels = shape.levels if above else -shape.levels
    order = np.lexsort((-camera.depth(p_n + shape.centres_b @ rotation.T), levels, shape.units, unit_depth))
    return [int(k) for k in order if visible[k]]


def _turned(shape: Mesh, index: int) -> Array:
    """Return the corners of all faces, with the propellers rotated for this picture [m] [FRD] (k, 3).

    index: number of the picture.
    """
    points = shape.points_b.copy()
    for k, paint in enumerate(shape.paints):
        if paint == "blade":
            unit = int(shape.units[k])
            angle = _BLADE_STEP_RAD * index * (1 if unit % 2 else -1) + unit
            c, s = np.cos(angle), np.sin(angle)
            own = shape.points_b[shape.corners[k]] - shape.centres_b[k]
            turned = own @ np.array([(c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)])
            points[shape.corners[k]] = shape.centres_b[k] + turned
    return points


@functools.cache
def _light(size_px: int) -> Image.Image:
    axis = np.linspace(-1.0, 1.0, size_px)
    far = np.hypot(axis[None, :], axis[:, None])
    return Image.fromarray(np.uint8(185 * np.clip(1.0 - far, 0.0, 1.0) ** 2.2))


def _glow(picture: Image.Image, camera: Camera, body: Body, size_px: float, colour: style.Colour) -> None:
    x, y = camera.project(body.p_n)
    size = round(max(2.6 * size_px, 24 * SUPERSAMPLING))
    picture.paste(colour, (round(x - size / 2), round(y - size / 2)), _light(size))


def _texts(picture: Image.Image, camera: Camera, bodies: Sequence[Body], heading: Sequence[str]) -> None:
    draw = ImageDraw.Draw(picture, "RGBA")
    unit = max(camera.height / 720.0, 0.75)
    named = [body for body in bodies if body.label]
    if len({body.label[0] for body in named}) <= MAX_LABELS:
        boxes = [_label_size(draw, body, unit) for body in named]
        for body, box, (x, y) in zip(named, boxes, label_places(camera, named, boxes), strict=True):
            _label(draw, body, box, x, y, unit)
    y = 16 * unit
    for k, text in enumerate(heading):
        size = round((24 if k == 0 else 17) * unit)
        draw.text((20 * unit, y), text, fill=style.TEXT if k == 0 else style.TEXT_DIM, font=style.font(size))
        y += 1.4 * size


def label_places(
    camera: Camera, bodies: Sequence[Body], boxes: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the position of each vehicle's label [px]: middle of its lower edge.

    A label is above its vehicle. It is moved up if it overlaps another label.

    boxes: width and height of each label [px].
    """
    found: list[tuple[float, float]] = []
    for k, (body, (width, height)) in enumerate(zip(bodies, boxes, strict=True)):
        x, y = (float(v) for v in camera.project(body.p_n))
        y -= 0.6 * body.airframe.radius_m * camera.pixels_per_metre(body.p_n) + 0.35 * height
        others = list(zip(found, boxes[:k], strict=True))
        while any(
            abs(x - a) < 0.5 * (width + w) + _LABEL_GAP_PX
            and b - h - _LABEL_GAP_PX < y
            and y - height - _LABEL_GAP_PX < b
            for (a, b), (w, h) in others
        ):
            y -= 0.25 * height
        found.append((x, y))
    return found


_LABEL_PX = ((17, 20), (13, 16))  # font and line height of the name and of the mode [px]
_LABEL_GAP_PX, _LABEL_PAD_PX = 2.0, 6.0


def _label_size(draw: ImageDraw.ImageDraw, body: Body, unit: float) -> tuple[float, float]:
    """Return width and height of a label [px].

    unit: size of one pixel of a picture with 720 rows [px].
    """
    lines = list(zip(body.label, _LABEL_PX, strict=False))
    width = max(draw.textlength(text, font=style.font(round(size * unit))) for text, (size, _) in lines)
    return width + 2 * _LABEL_PAD_PX * unit, sum(
        height for _, (_, height) in lines
    ) * unit + _LABEL_PAD_PX * unit


def _label(
    draw: ImageDraw.ImageDraw, body: Body, box: tuple[float, float], x: float, y: float, unit: float
) -> None:
    area = (x - box[0] / 2, y - box[1], x + box[0] / 2, y)
    draw.rounded_rectangle(area, 5 * unit, fill=(*style.TAG, 150))
    top = y - box[1] + 0.4 * _LABEL_PAD_PX * unit
    for k, (text, (size, height)) in enumerate(zip(body.label, _LABEL_PX, strict=False)):
        fill = style.mixed(body.colour, style.TEXT, 0.25) if k == 0 else style.TEXT_DIM
        draw.text((x, top), text, fill=fill, font=style.font(round(size * unit)), anchor="ma")
        top += height * unit
