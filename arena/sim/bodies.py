"""Rigid bodies in pybullet, with the project's conventions: vectors are NED and FRD, quaternions wxyz.

Only this module converts from and to pybullet's conventions: quaternions xyzw, a z-up world (the `w` frame),
links in FLU, and angular velocity in *world* axes. By default pybullet damps linear and angular velocity by
0.04 and computes the inertia from the collision shape; both are overridden. The room has an infinite floor,
a wall on each side, as high as the arena, and a ceiling unless it is open to the sky.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError, NotInstalledError, RunError
from arena.geometry import (
    frd_from_flu,
    matrix_from_quat,
    ned_from_world,
    q_nb_from_q_wf,
    q_wf_from_q_nb,
    world_from_ned,
    wxyz_from_xyzw,
    xyzw_from_wxyz,
)
from arena.sim.vehicle_arrays import Fleet

Array = NDArray[np.float64]
Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]

_FRICTION = 0.8
_WALL_M = 1.0
# Contacts with a larger distance are gaps [m]. A resting body stays below this distance.
_TOUCH_M = 1e-3
_ORIGIN = (0.0, 0.0, 0.0)
# Converts bullet's position, velocity, rate and attitude of a body to p_n, v_n, omega_n and q_nb in one product: each
# conversion is linear, so its matrix is obtained by converting the unit vectors.
_NED = np.zeros((13, 13))
for _at in (0, 3, 6):
    _NED[_at : _at + 3, _at : _at + 3] = ned_from_world(np.eye(3))
_NED[9:, 9:] = q_nb_from_q_wf(wxyz_from_xyzw(np.eye(4)))


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """Contacts of the vehicles with the floor, walls, ceiling and other vehicles after one step.

    floor: True for each vehicle that touches the floor (V,)
    others: name of the wall, ceiling or vehicle that a vehicle touches, by row of the vehicle
    """

    floor: NDArray[np.bool_]
    others: dict[int, str]


class Bodies:
    """Rigid bodies of a fleet in a room.

    fleet: the vehicles' bodies and their start positions
    size_m: size of the room: north, east, height [m]
    ceiling: False for a room that is open to the sky
    step_s: physics step [s]
    gui: True opens pybullet's window

    These attributes are valid after construction and after each `step`:

    p_n: position of the body origin [m] [NED] (V, 3)
    q_nb: attitude [-] wxyz (V, 4); r_nb: its rotation matrix (V, 3, 3)
    v_n: velocity [m/s] [NED] (V, 3)
    omega_b: angular velocity [rad/s] [FRD] (V, 3)
    """

    def __init__(
        self,
        fleet: Fleet,
        *,
        size_m: Sequence[float],
        step_s: float,
        ceiling: bool = True,
        gui: bool = False,
    ) -> None:
        self._bullet = _import()
        self._client = _connect(self._bullet, gui)
        self._fleet = fleet
        self._bullet.setGravity(0.0, 0.0, -GRAVITY_M_S2, physicsClientId=self._client)
        self._bullet.setTimeStep(step_s, physicsClientId=self._client)
        self._bullet.setPhysicsEngineParameter(
            numSubSteps=0, deterministicOverlappingPairs=1, physicsClientId=self._client
        )
        self._things = {self._floor(): "floor"} | self._walls(size_m)
        if ceiling:
            self._things[self._ceiling(size_m)] = "the ceiling"
        self._ids = [self._vehicle(i) for i in range(fleet.size)]
        self._index = {body: i for i, body in enumerate(self._ids)}
        self._omega_b: Array | None = None
        self.read()

    def apply_wrenches(self, force_b: Array, torque_b: Array) -> None:
        """Apply a force and a torque to every body at its centre of mass, for one step.

        force_b: [N] [FRD] (V, 3)
        torque_b: [N m] [FRD] (V, 3)
        """
        bullet, client = self._bullet, self._client
        frame = bullet.LINK_FRAME
        apply_force, apply_torque = bullet.applyExternalForce, bullet.applyExternalTorque
        forces, torques = frd_from_flu(force_b).tolist(), frd_from_flu(torque_b).tolist()  # its own inverse
        for body, force, torque in zip(self._ids, forces, torques, strict=True):
            apply_force(body, -1, force, _ORIGIN, frame, client)
            apply_torque(body, -1, torque, frame, client)

    def apply_wrench(self, i: int, force_b: Triple, torque_b: Triple) -> None:
        """Apply a force and a torque to body `i` at its centre of mass, for one step.

        force_b: [N] [FRD]
        torque_b: [N m] [FRD]
        """
        bullet, client, body = self._bullet, self._client, self._ids[i]
        (fx, fy, fz), (tx, ty, tz) = force_b, torque_b
        bullet.applyExternalForce(body, -1, (fx, -fy, -fz), _ORIGIN, bullet.LINK_FRAME, client)
        bullet.applyExternalTorque(body, -1, (tx, -ty, -tz), bullet.LINK_FRAME, client)

    def step(self) -> None:
        """Make one physics step (`advance`), then read the new state of all vehicles from pybullet (`read`)."""
        self.advance()
        self.read()

    def advance(self) -> None:
        """Make one physics step with the forces and torques applied since the last step. The new state is not read.

        Raises RunError if pybullet has ended.
        """
        try:
            self._bullet.stepSimulation(self._client)
        except self._bullet.error as error:
            raise RunError(f"pybullet ended: {error}. Was its window closed?") from error

    def motion(self, i: int) -> tuple[Triple, Matrix, float]:
        """Return the current motion of one vehicle, read from pybullet.

        Returns v_n [m/s] [NED], r_nb, and the height of the body origin above the floor [m].
        """
        (_, _, height), (x, y, z, w) = self._bullet.getBasePositionAndOrientation(self._ids[i], self._client)
        (vx, vy, vz), _ = self._bullet.getBaseVelocity(self._ids[i], self._client)
        xx, yy, zz, ww = x * x, y * y, z * z, w * w
        xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
        # The matrix of q_wf with its rows in NED and its columns in FRD: the same as `read` computes by quaternions.
        r_nb = (
            (2.0 * (xy + wz), xx + zz - yy - ww, 2.0 * (wx - yz)),
            (ww + xx - yy - zz, 2.0 * (wz - xy), -2.0 * (xz + wy)),
            (2.0 * (wy - xz), 2.0 * (yz + wx), ww + zz - xx - yy),
        )
        return (vy, vx, -vz), r_nb, height

    def contacts(self) -> Contacts:
        """Return which vehicles touched the floor, a wall, the ceiling or another vehicle in the last step."""
        floor = np.zeros(self._fleet.size, bool)
        others: dict[int, str] = {}
        for point in self._bullet.getContactPoints(physicsClientId=self._client):
            if point[8] > _TOUCH_M:
                continue
            for one, other in ((point[1], point[2]), (point[2], point[1])):
                if one in self._index:
                    what = self._things.get(other) or self._fleet.names[self._index[other]]
                    if what == "floor":
                        floor[self._index[one]] = True
                    else:
                        others[self._index[one]] = what
        return Contacts(floor=floor, others=others)

    def place(
        self, index: int, *, p_n: Array, q_nb: Array, v_n: Array | None = None, omega_b: Array | None = None
    ) -> None:
        """Set position, attitude and velocities of one vehicle. For tests and experiments.

        p_n: position [m] [NED] (3,)
        q_nb: attitude [-] wxyz (4,)
        v_n: velocity [m/s] [NED] (3,), None for zero
        omega_b: angular velocity [rad/s] [FRD] (3,), None for zero
        """
        body, client = self._ids[index], self._client
        r_nb = matrix_from_quat(q_nb)
        omega_n = r_nb @ (np.zeros(3) if omega_b is None else omega_b)
        position, quat = world_from_ned(p_n).tolist(), xyzw_from_wxyz(q_wf_from_q_nb(q_nb)).tolist()
        self._bullet.resetBasePositionAndOrientation(body, position, quat, physicsClientId=client)
        velocity = world_from_ned(np.zeros(3) if v_n is None else v_n).tolist()
        self._bullet.resetBaseVelocity(
            body, velocity, world_from_ned(omega_n).tolist(), physicsClientId=client
        )
        self.read()

    @property
    def omega_b(self) -> Array:
        """Angular velocity in body axes [rad/s] [FRD] (V, 3), computed at the first access after each step."""
        if self._omega_b is None:  # a row vector times R is R^T times the vector: b from n
            self._omega_b = (self._omega_n[:, None, :] @ self.r_nb)[:, 0]
        return self._omega_b

    def close(self) -> None:
        """End pybullet's physics simulation."""
        if self._bullet.isConnected(self._client):
            self._bullet.disconnect(self._client)

    def read(self) -> None:
        """Read the state of all vehicles from pybullet."""
        bullet, client = self._bullet, self._client
        pose, velocity = bullet.getBasePositionAndOrientation, bullet.getBaseVelocity
        rows: list[float] = []
        for body in self._ids:
            position, quat = pose(body, client)
            linear, angular = velocity(body, client)
            rows += position
            rows += linear
            rows += angular
            rows += quat
        found = np.array(rows).reshape(-1, 13) @ _NED
        self.p_n, self.v_n, self._omega_n, self.q_nb = (
            found[:, 0:3],
            found[:, 3:6],
            found[:, 6:9],
            found[:, 9:],
        )
        self.r_nb = matrix_from_quat(self.q_nb)
        self._omega_b = None

    def _floor(self) -> int:
        return self._fixed(
            self._bullet.createCollisionShape(self._bullet.GEOM_PLANE, physicsClientId=self._client), _ORIGIN
        )

    def _walls(self, size_m: Sequence[float]) -> dict[int, str]:
        north, east, height = (float(x) for x in size_m)
        walls = {}
        for name, axis, sign in (("north", 0, 1), ("south", 0, -1), ("east", 1, 1), ("west", 1, -1)):
            centre_n, half_n = np.zeros(3), np.array([north, east, height]) / 2.0 + _WALL_M
            centre_n[axis] = sign * ((north, east)[axis] / 2.0 + _WALL_M / 2.0)
            half_n[axis], half_n[2] = _WALL_M / 2.0, height / 2.0
            centre_n[2] = -height / 2.0
            walls[self._box(centre_n, half_n)] = f"the {name} wall"
        return walls

    def _ceiling(self, size_m: Sequence[float]) -> int:
        north, east, height = (float(x) for x in size_m)
        centre_n = np.array([0.0, 0.0, -height - _WALL_M / 2.0])
        return self._box(centre_n, np.array([north, east, 0.0]) / 2.0 + [_WALL_M, _WALL_M, _WALL_M / 2.0])

    def _box(self, centre_n: Array, half_n: Array) -> int:
        """Add a fixed box to the room; return its pybullet id. half_n: half of its size along north, east, down [m]."""
        shape = self._bullet.createCollisionShape(
            self._bullet.GEOM_BOX,
            halfExtents=np.abs(world_from_ned(half_n)).tolist(),
            physicsClientId=self._client,
        )
        return self._fixed(shape, world_from_ned(centre_n).tolist())

    def _fixed(self, shape: int, position_w: Sequence[float]) -> int:
        body = self._bullet.createMultiBody(0.0, shape, basePosition=position_w, physicsClientId=self._client)
        self._bullet.changeDynamics(
            body, -1, restitution=0.0, lateralFriction=_FRICTION, physicsClientId=self._client
        )
        return int(body)

    def _vehicle(self, i: int) -> int:
        bullet, client, fleet = self._bullet, self._client, self._fleet
        # The origin is the centre of mass; the cylinder hangs so that its bottom is origin_height below it.
        up = float(fleet.height[i] / 2.0 - fleet.origin_height[i])
        shape = bullet.createCollisionShape(
            bullet.GEOM_CYLINDER,
            radius=float(fleet.radius[i]),
            height=float(fleet.height[i]),
            collisionFramePosition=(0.0, 0.0, up),
            physicsClientId=client,
        )
        body = bullet.createMultiBody(
            float(fleet.mass[i]),
            shape,
            basePosition=world_from_ned(fleet.start_p_n[i]).tolist(),
            baseOrientation=xyzw_from_wxyz(q_wf_from_q_nb(fleet.start_q_nb[i])).tolist(),
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


def _import() -> Any:
    """Import pybullet without the line that pybullet prints on import."""
    try:
        with _no_stderr():
            import pybullet
    except ImportError as error:
        raise NotInstalledError("the simulated world needs pybullet: install flying-arena[sim]") from error
    return pybullet


@contextlib.contextmanager
def _no_stderr() -> Iterator[None]:
    """Discard all output to stderr, also that of C code."""
    kept, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


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
    """Return whether the X server of a display accepts connections, so that pybullet can open its window.

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
