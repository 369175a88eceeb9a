"""The room in pybullet, with the vehicles that are near a wall, an obstacle or each other.

Only this module calls pybullet. Quaternions are xyzw, and all vectors are in pybullet's world with z up. By default
pybullet damps linear and angular velocity by 0.04 and computes the inertia from the collision shape; both are
overridden. The room has an infinite floor, a wall on each side, as high as the room, and a ceiling unless it is open to
the sky.
"""

from __future__ import annotations

import contextlib
import os
import socket
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError, NotInstalledError, RunError
from arena.geometry import q_wf_from_q_nb, world_from_ned, xyzw_from_wxyz
from arena.obstacles import Obstacle
from arena.sim.vehicle_arrays import Fleet

Array = NDArray[np.float64]

_FRICTION = 0.8
_WALL_M = 1.0
# Contacts with a larger distance are gaps [m]. A resting body stays below this distance.
_TOUCH_M = 1e-3
_ORIGIN = (0.0, 0.0, 0.0)
_LEVEL = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """Contacts of the vehicles with the room, obstacles and other vehicles after one step.

    floor: True for each vehicle that touches the floor (V,)
    others: name of the wall, ceiling, obstacle or vehicle that a vehicle touches, by row of the vehicle
    """

    floor: NDArray[np.bool_]
    others: dict[int, str]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Position, attitude and velocities of one or more bodies in pybullet's axes.

    place: position of the body origin [m] (..., 3)
    quat: attitude xyzw, from body axes FLU to the world (..., 4)
    speed, rate: velocity [m/s] and angular velocity [rad/s] (..., 3)
    """

    place: Array
    quat: Array
    speed: Array
    rate: Array


class PybulletRoom:
    """Room in pybullet: floor, walls, ceiling and obstacles, with some vehicles of a fleet.

    The room begins without vehicles.

    fleet: the vehicles' bodies
    size_m: size of the room: north, east, height [m]
    ceiling: False for a room that is open to the sky
    obstacles: fixed bodies in the room
    step_s: physics step [s]
    gui: True opens pybullet's window

    boxes: centre and half size of each wall, of the ceiling, and of the box around each obstacle [m] (B, 6)
    """

    def __init__(
        self,
        fleet: Fleet,
        *,
        size_m: Sequence[float],
        step_s: float,
        ceiling: bool,
        gui: bool,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        self._bullet = _import()
        self._client = _connect(self._bullet, gui)
        self._end = weakref.finalize(self, _disconnect, self._bullet, self._client)
        self._fleet = fleet
        self._bullet.setGravity(0.0, 0.0, -GRAVITY_M_S2, physicsClientId=self._client)
        self._bullet.setTimeStep(step_s, physicsClientId=self._client)
        self._bullet.setPhysicsEngineParameter(
            numSubSteps=0, deterministicOverlappingPairs=1, physicsClientId=self._client
        )
        boxes = _walls(size_m) | ({"the ceiling": _ceiling(size_m)} if ceiling else {})
        around = [_in_world(np.array(o.centre_n), np.array(o.half_extents_n)) for o in obstacles]
        self.boxes: Array = np.stack([*boxes.values(), *around])
        self._things = {self._floor(): "floor"} | {self._box(box): name for name, box in boxes.items()}
        self._things |= {self._obstacle(o): f"the obstacle {o.name}" for o in obstacles}
        self._bodies: dict[int, int] = {}  # vehicle -> its body in pybullet
        self._shapes: dict[int, int] = {}  # vehicle -> its collision shape in pybullet
        self._vehicles: dict[int, int] = {}  # body in pybullet -> vehicle
        self._no_contacts = Contacts(floor=np.zeros(fleet.size, bool), others={})

    def add(self, i: int, motion: Motion) -> None:
        """Add vehicle number i to pybullet's world, with its position, attitude and velocities."""
        body = self._bodies[i] = self._vehicle(i, motion)
        self._vehicles[body] = i
        self.move(i, motion)

    def remove(self, i: int) -> None:
        """Remove vehicle number i from the room."""
        body = self._bodies.pop(i)
        del self._vehicles[body]
        self._bullet.removeBody(body, self._client)

    def move(self, i: int, motion: Motion) -> None:
        """Set position, attitude and velocities of vehicle number i."""
        bullet, body, client = self._bullet, self._bodies[i], self._client
        bullet.resetBasePositionAndOrientation(
            body, motion.place.tolist(), motion.quat.tolist(), physicsClientId=client
        )
        bullet.resetBaseVelocity(body, motion.speed.tolist(), motion.rate.tolist(), physicsClientId=client)

    def step(self, vehicles: Sequence[int], force: Array, torque: Array) -> Motion:
        """Make one physics step of the vehicles in the room and return their new motion.

        The order is that of `vehicles`.

        vehicles: all vehicles in the room (n,)
        force, torque: on each of them at its centre of mass, for this step [N], [N m] [FLU] (n, 3)

        Raises RunError if pybullet has ended.
        """
        bullet, client, frame = self._bullet, self._client, self._bullet.LINK_FRAME
        bodies = [self._bodies[i] for i in vehicles]
        apply_force, apply_torque = bullet.applyExternalForce, bullet.applyExternalTorque
        for body, push, twist in zip(bodies, force.tolist(), torque.tolist(), strict=True):
            apply_force(body, -1, push, _ORIGIN, frame, client)
            apply_torque(body, -1, twist, frame, client)
        try:
            bullet.stepSimulation(client)
        except bullet.error as error:
            raise RunError(
                f"the pybullet physics simulation has ended: {error}. Was its window closed?"
            ) from error
        pose, velocity = bullet.getBasePositionAndOrientation, bullet.getBaseVelocity
        rows: list[float] = []
        for body in bodies:
            place, quat = pose(body, client)
            speed, rate = velocity(body, client)
            rows += place
            rows += quat
            rows += speed
            rows += rate
        found = np.array(rows).reshape(-1, 13)
        return Motion(place=found[:, :3], quat=found[:, 3:7], speed=found[:, 7:10], rate=found[:, 10:])

    def contacts(self) -> Contacts:
        """Return the contacts of the vehicles in the last step."""
        if not self._bodies:
            return self._no_contacts
        floor, vehicles = np.zeros(self._fleet.size, bool), self._vehicles
        others: dict[int, str] = {}
        for point in self._bullet.getContactPoints(physicsClientId=self._client):
            if point[8] > _TOUCH_M:
                continue
            for one, other in ((point[1], point[2]), (point[2], point[1])):
                if one in vehicles:
                    what = self._things.get(other) or self._fleet.names[vehicles[other]]
                    if what == "floor":
                        floor[vehicles[one]] = True
                    else:
                        others[vehicles[one]] = what
        return Contacts(floor=floor, others=others)

    def close(self) -> None:
        """End pybullet's physics simulation. It also ends when this object is deleted."""
        self._end()

    def _floor(self) -> int:
        return self._fixed(
            self._bullet.createCollisionShape(self._bullet.GEOM_PLANE, physicsClientId=self._client), _ORIGIN
        )

    def _box(self, box: Array) -> int:
        """Add a fixed box to pybullet's world; return its pybullet id.

        box: centre and half size [m] (6,)
        """
        shape = self._bullet.createCollisionShape(
            self._bullet.GEOM_BOX, halfExtents=box[3:].tolist(), physicsClientId=self._client
        )
        return self._fixed(shape, box[:3].tolist())

    def _obstacle(self, obstacle: Obstacle) -> int:
        """Add an obstacle to pybullet's world; return its pybullet id."""
        bullet, (length, width, height) = self._bullet, obstacle.size_m
        if obstacle.shape == "box":
            kind: int = bullet.GEOM_BOX
            sizes: dict[str, Any] = {"halfExtents": [0.5 * length, 0.5 * width, 0.5 * height]}
        elif obstacle.shape == "cylinder":
            kind, sizes = bullet.GEOM_CYLINDER, {"radius": 0.5 * length, "height": height}
        else:
            kind, sizes = bullet.GEOM_SPHERE, {"radius": 0.5 * length}
        shape = bullet.createCollisionShape(kind, physicsClientId=self._client, **sizes)
        quat = xyzw_from_wxyz(q_wf_from_q_nb(obstacle.q_nb)).tolist()
        return self._fixed(shape, world_from_ned(obstacle.centre_n).tolist(), quat)

    def _fixed(self, shape: int, place: Sequence[float], quat: Sequence[float] = _LEVEL) -> int:
        body = self._bullet.createMultiBody(
            0.0, shape, basePosition=place, baseOrientation=quat, physicsClientId=self._client
        )
        self._bullet.changeDynamics(
            body, -1, restitution=0.0, lateralFriction=_FRICTION, physicsClientId=self._client
        )
        return int(body)

    def _shape(self, i: int) -> int:
        """Return the collision shape of vehicle number i.

        It is made once, because pybullet keeps the shape when a body is removed.
        """
        if i not in self._shapes:
            self._shapes[i] = self._cylinder(i)
        return self._shapes[i]

    def _cylinder(self, i: int) -> int:
        bullet, fleet = self._bullet, self._fleet
        # The origin is the centre of mass; the cylinder hangs so that its bottom is origin_height below it.
        up = float(fleet.height[i] / 2.0 - fleet.origin_height[i])
        shape = bullet.createCollisionShape(
            bullet.GEOM_CYLINDER,
            radius=float(fleet.radius[i]),
            height=float(fleet.height[i]),
            collisionFramePosition=(0.0, 0.0, up),
            physicsClientId=self._client,
        )
        return int(shape)

    def _vehicle(self, i: int, motion: Motion) -> int:
        bullet, client, fleet = self._bullet, self._client, self._fleet
        body = bullet.createMultiBody(
            float(fleet.mass[i]),
            self._shape(i),
            basePosition=motion.place.tolist(),
            baseOrientation=motion.quat.tolist(),
            physicsClientId=client,
        )
        bullet.changeDynamics(
            body,
            -1,
            linearDamping=0.0,
            angularDamping=0.0,
            restitution=0.0,
            lateralFriction=_FRICTION,
            localInertiaDiagonal=fleet.inertia[i].tolist(),
            physicsClientId=client,
            activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        )
        return int(body)


def _walls(size_m: Sequence[float]) -> dict[str, Array]:
    """Return the four walls: name -> centre and half size [m] (6,)."""
    north, east, height = (float(x) for x in size_m)
    walls = {}
    for name, axis, sign in (("north", 0, 1), ("south", 0, -1), ("east", 1, 1), ("west", 1, -1)):
        centre_n, half_n = np.zeros(3), np.array([north, east, height]) / 2.0 + _WALL_M
        centre_n[axis] = sign * ((north, east)[axis] / 2.0 + _WALL_M / 2.0)
        half_n[axis], half_n[2] = _WALL_M / 2.0, height / 2.0
        centre_n[2] = -height / 2.0
        walls[f"the {name} wall"] = _in_world(centre_n, half_n)
    return walls


def _ceiling(size_m: Sequence[float]) -> Array:
    north, east, height = (float(x) for x in size_m)
    centre_n = np.array([0.0, 0.0, -height - _WALL_M / 2.0])
    return _in_world(centre_n, np.array([north, east, 0.0]) / 2.0 + [_WALL_M, _WALL_M, _WALL_M / 2.0])


def _in_world(centre_n: Array, half_n: Array) -> Array:
    """Convert a box from NED to pybullet's axes. Return its centre and half size [m] (6,).

    centre_n, half_n: centre and half size of the box [m] [NED] (3,)
    """
    return np.concatenate([world_from_ned(centre_n), np.abs(world_from_ned(half_n))])


def _import() -> Any:
    """Import pybullet. The line that pybullet prints on import is suppressed."""
    try:
        with _no_stderr():
            import pybullet
    except ImportError as error:
        raise NotInstalledError(
            "the simulated world needs pybullet: pip install 'flying-arena[sim]'"
        ) from error
    return pybullet


@contextlib.contextmanager
def _no_stderr() -> Iterator[None]:
    """Discard all output to stderr, including output of C code."""
    kept, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


def _disconnect(bullet: Any, client: int) -> None:
    if bullet.isConnected(client):  # nobody has closed the window
        bullet.disconnect(client)


def _connect(bullet: Any, gui: bool) -> int:
    """Start pybullet's physics simulation and return its client id.

    Raises InputError if a window is requested and no display replies, because pybullet would then end the
    process.

    gui: True opens a window
    """
    if gui and not display_answers(os.environ.get("DISPLAY", "")):
        shown = os.environ.get("DISPLAY") or "not set"
        raise InputError(
            f"--gui needs an X display, but none replies (DISPLAY is {shown}): start without --gui, or set DISPLAY"
        )
    client = bullet.connect(bullet.GUI if gui else bullet.DIRECT)
    if client < 0:
        raise InputError("pybullet could not start" + (" its window: start without --gui" if gui else ""))
    return int(client)


def display_answers(display: str) -> bool:
    """Return whether the X server of a display accepts connections. pybullet needs it for its window.

    display: value of $DISPLAY, `[host]:number[.screen]`
    """
    host, colon, rest = display.rpartition(":")
    number = rest.split(".")[0]
    if not colon or not number.isdigit():
        return False
    if host and host != "unix":
        return _reaches(socket.AF_INET, (host, 6000 + int(number)))
    path = f"/tmp/.X11-unix/X{number}"
    return _reaches(socket.AF_UNIX, path) or _reaches(socket.AF_UNIX, "\0" + path)


def _reaches(
    family: Literal[socket.AddressFamily.AF_INET, socket.AddressFamily.AF_UNIX], address: Any
) -> bool:
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.settimeout(2.0)
        try:
            probe.connect(address)
        except OSError:
            return False
    return True
