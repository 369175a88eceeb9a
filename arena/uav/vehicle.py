"""`UAV`, the class with which a user program flies a vehicle: its data groups, commands, setpoints and connection."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock, WallClock
from arena.thrust_curve import thrust_curve as curve_of
from arena.trajectories.trajectory import Trajectory
from arena.uav.backend import BackendName
from arena.uav.connection import Connection
from arena.uav.data_groups import Actuation, Ekf, Info, Sensors, Snapshot
from arena.uav.data_source import Body, Source
from arena.uav.fleet import Fleet
from arena.uav.flight_steps import FlightSteps
from arena.uav.heartbeat import Heartbeat
from arena.uav.measurements import Measurements, RelativeSensors
from arena.uav.membership import MEMBERSHIP
from arena.uav.planned_path import PathPublisher
from arena.uav.poses import Poses
from arena.uav.receiver import Receiver
from arena.uav.setpoints import AttitudeKind, Encoder, duration_s
from arena.uav.shared_capture import Capture
from arena.uav.start_barrier import StartBarrier
from arena.uav.steps import Steps, run
from arena.uav.vehicle_control import STREAM_HZ, VehicleControl

T = TypeVar("T")


class UAV:
    """A vehicle that a user program flies. A simulated and a real vehicle are used in the same way.

    ns: name of the vehicle.
    mass: [kg]. radius, height: [m].
    thrust_curve: settings from the profile, see `arena.thrust_curve`.
    link: "udpin:HOST:PORT", the address that receives the vehicle's MAVLink.
    system_id: MAV_SYS_ID of the vehicle.
    capture: settings of the motion-capture client for the vehicle's own pose.
    body: name of the vehicle's rigid body in motion capture; by default `ns`.
    clock: clock for the arguments `time` and `freq`; the wall clock by default.
    sensors: emulated relative sensors of the vehicle, for `sen.neighbours` and `sen.beacons`; None: it has none.
    stale_s: age above which data are too old to use [s].
    heartbeat: address of the copilot, None without one. Heartbeats are sent only in calls of this object.
    log: address of the recorder, None without one.
    run: folder of the run, None for a program started by hand.
    barriers: folder with the files of `wait_for`. programs: vehicles of the run that have a program.
    args: arguments for the program itself.
    receiver: background thread and motion capture clients for several vehicles of this process; None for its own.
    backend: library that sends setpoints and commands: "mavlink" (pymavlink) or "mavsdk".

    control, steps: the methods as steps, for `AsyncUAV`.

    Setpoints are sent only while one of the methods runs. If a program stops calling them, nothing is sent,
    and the autopilot's offboard failsafe lands the vehicle. `close` sends no command.
    """

    def __init__(  # noqa: PLR0913 the thesis's signature, and where to find the vehicle
        self,
        ns: str,
        mass: float,
        radius: float,
        height: float,
        num_rotors: int,
        thrust_curve: Mapping[str, Any],
        *,
        link: str,
        system_id: int,
        capture: Capture | None = None,
        body: str | None = None,
        clock: Clock | None = None,
        sensors: RelativeSensors | None = None,
        stale_s: float = 0.5,
        heartbeat: tuple[str, int] | None = None,
        log: tuple[str, int] | None = None,
        run: str | None = None,
        barriers: str | None = None,
        programs: Sequence[str] = (),
        args: Sequence[str] = (),
        receiver: Receiver | None = None,
        backend: BackendName = "mavlink",
    ) -> None:
        self.clock: Clock = WallClock() if clock is None else clock
        self.args = list(args)
        poses = Poses((body or ns) if capture else None)
        relative = Measurements(RelativeSensors() if sensors is None else sensors, system_id)
        self._connection = Connection(
            link, system_id, self.clock, poses, capture, receiver, backend, relative
        )
        self._source = Source(
            ns=ns,
            stale_s=stale_s,
            telemetry=self._connection.telemetry,
            poses=poses,
            relative=relative,
            now=self.clock.now,
            refresh=self._connection.refresh,
        )
        self._body = Body(
            ns=ns, mass=mass, radius=radius, height=height, num_rotors=num_rotors, thrust_curve=thrust_curve
        )
        self._heartbeat, self._log = Heartbeat(heartbeat, system_id, self.clock), log
        self.control = VehicleControl(
            self._source,
            self._connection,
            self.clock,
            system_id,
            self._heartbeat,
            None if run is None else Path(run),
        )
        self._barrier = StartBarrier(ns, None if barriers is None else Path(barriers), programs)
        paths = PathPublisher(None if log is None else lambda m: self._connection.send_to(m, log))
        curve = curve_of(thrust_curve)
        self.steps = FlightSteps(self.control, self._source, self.clock, self._barrier, curve, paths)
        live = Snapshot.of(self._source, self._body)
        self.ekf: Ekf = live.ekf
        self.sen: Sensors = live.sen
        self.act: Actuation = live.act
        self.info: Info = live.info

    @classmethod
    def from_args(cls, argv: Sequence[str] | None = None) -> UAV:
        """Return the vehicle that the command line selects.

        `arena up` passes `--uav FILE`. By hand: `--ns uav1 --id 1 --link udpin:127.0.0.1:16001 --profile
        iris`. Other arguments are available to the program in `uav.args`.
        """
        from arena.uav.arguments import read_arguments

        made = cls(**read_arguments(argv))
        if argv is None and (member := MEMBERSHIP.get()) is not None:
            member.opened.append(made)
            if member.threads.lockstep:  # only one thread runs at a time
                made.control.share_thread()
        return made

    @classmethod
    def all_from_args(cls) -> Fleet[UAV]:
        """Return all vehicles of a group, for one program that flies them all.

        The YAML of these vehicles has `program: {path: FILE.py, group: NAME, run: once}`.
        """
        from arena.uav.arguments import read_group

        member = MEMBERSHIP.get()
        found = read_group(member)
        assert member is not None
        made = []
        for each in found:
            made.append(cls(**each))
            made[-1].control.share_thread()
            member.opened.append(made[-1])
        return Fleet(made, member.threads)

    def snapshot(self) -> Snapshot:
        """Return a copy of the data groups (`ekf`, `sen`, `act`, `info`). The values of the copy never change."""
        return Snapshot.of(self._source.fixed(), self._body)

    def last_values(self, limit_s: float = np.inf) -> Snapshot:
        """Return the data groups without age limit: each access returns the last value that has arrived, however old it is.

        Use it for displays and logs, not for control. A value that has never arrived raises StaleDataError.
        limit_s: age limit in place of `stale_s` [s]
        """
        return Snapshot.of(dataclasses.replace(self._source, stale_s=limit_s), self._body)

    def arm_drone(self) -> None:
        """Arm the vehicle and wait for the confirmation.

        Raises CommandRefusedError, with the autopilot's reasons.
        """
        self._run(self.control.arm())

    def disarm_drone(self) -> None:
        """Disarm the vehicle and wait for the confirmation. The autopilot refuses this in the air."""
        self._run(self.control.disarm())

    def start_offboard_mode(self) -> None:
        """Enter OFFBOARD at the current position and wait for the confirmation. Setpoints are sent during the wait."""
        self._run(self.control.enter_offboard())

    def start_offboard_mission(self) -> None:
        """Wait until the vehicle is ready (at most 20 s), enter OFFBOARD and arm.

        Wait for the confirmation of each step.

        Setpoints are sent all the time. If arming is temporarily rejected, e.g. because poses were missing for
        a moment, it is requested again within the 20 s. Raises CommandRefusedError with the autopilot's reasons
        after that.
        """
        self._run(self.control.start_mission())

    def auto_land(self, wait: bool = True) -> None:
        """Land at the current position. Return when the vehicle is on the ground and disarmed.

        Raises NotConfirmedError after 60 s.
        wait: False returns as soon as the autopilot has confirmed AUTO.LAND. The vehicle is then still in the air.
        """
        self._run(self.control.land(wait=wait))

    def set_pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, time: ArrayLike) -> None:
        """Fly to a position: send the setpoint at 50 Hz for `time` seconds.

        pos: [m] [NED] (3,). yaw: [rad].
        time: [s]. Then the method returns, even if the vehicle has not reached the position.
        """
        self._run(self.steps.pos_yaw(pos, yaw, time))

    def set_vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint, then wait until the next setpoint is due: a loop with one such call runs at `freq`.

        vel: [m/s] [NED] (3,). yaw: [rad]. freq: [Hz].
        """
        self._run(self.steps.vel_yaw(vel, yaw, freq))

    def set_pos_vel_yaw(
        self,
        pos: ArrayLike,
        vel: ArrayLike,
        yaw: ArrayLike,
        freq: ArrayLike,
        *,
        acc: ArrayLike | None = None,
        yaw_rate: ArrayLike | None = None,
    ) -> None:
        """Send a trajectory setpoint, then wait until the next setpoint is due: a loop with one such call runs at `freq`.

        The autopilot flies to `pos` with `vel` and `acc` as feed-forward, so that it does not lag behind a moving position.
        pos: [m] [NED] (3,). vel: [m/s] [NED] (3,). yaw: [rad]. freq: [Hz].
        acc: [m/s2] [NED] (3,), without gravity; None sends no acceleration. yaw_rate: [rad/s]; None sends none.
        """
        self._run(self.steps.pos_vel_yaw(pos, vel, yaw, freq, acc=acc, yaw_rate=yaw_rate))

    def follow(self, trajectory: Trajectory, freq: ArrayLike = STREAM_HZ) -> None:
        """Fly along a trajectory: send its position, velocity, acceleration and yaw as setpoints until it ends.

        trajectory: object with `duration_s` and `at(t)`, such as those of `arena.trajectories`. Its positions are those of the arena
        [m] [NED]. freq: [Hz]. The path of a trajectory of `arena.trajectories` is published as by `planned_path`.
        """
        self._run(self.steps.follow(trajectory, freq))

    def planned_path(self, points: ArrayLike) -> None:
        """Publish the path that the program plans to fly, for viewers and the record. Nothing is sent to the vehicle. Return at once.

        points: [m] [NED] (k, 3), of which at most 200 are sent; an empty list removes the path.
        """
        self.steps.paths.publish(points, self.clock.now())

    def reference(
        self, p: ArrayLike | None = None, v: ArrayLike | None = None, yaw: ArrayLike | None = None
    ) -> None:
        """Log the position, velocity and yaw that the program wants to follow: send them to the recorder. Return at once.

        Call this method if the setpoints do not contain these values: a controller that sends rate setpoints, for example.
        p: [m] [NED] (3,). v: [m/s] [NED] (3,). yaw: [rad]. Omit values that the reference does not have.
        The log repeats the values for 0.5 s, in `pos_ref`, `vel_ref` and `pos_ref.yaw`. Without a recorder nothing is sent.
        """
        message = self.control.encoder.reference(p, v, yaw, self.clock.now())
        if self._log is not None:
            self._connection.send_to(message, self._log)

    def wait_for(self, name: str, n: int | None = None, timeout: ArrayLike = 30.0) -> float:
        """Wait until the other programs of the run have called `wait_for` too, so that all continue at the same time.

        Return this time [s] of `clock`.

        name: name of the barrier. All programs that wait for the same name start together. A name may be used
        again: a program's second call waits for the second calls of the others.
        n: number of programs that take part, including this program; None for all programs of the arena.
        timeout: [s].
        In OFFBOARD the vehicle holds its position while it waits.
        Raises NotConfirmedError after the timeout, with the missing programs.
        """
        return self._run(self.steps.wait_for(name, n, timeout))

    def set_vel_body_yaw_rate(self, vel_body: ArrayLike, yaw_rate: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint in vehicle axes, then wait until the next setpoint is due: a loop with one such call runs at `freq`.

        vel_body: forward, right, down [m/s] (3,). The axes turn with the vehicle's yaw and stay level when the vehicle tilts.
        yaw_rate: [rad/s]. freq: [Hz].
        """
        self._run(self.steps.vel_body_yaw_rate(vel_body, yaw_rate, freq))

    def set_att_thrust(
        self, att: ArrayLike, att_type: AttitudeKind, thrust: ArrayLike, freq: ArrayLike
    ) -> None:
        """Send an attitude setpoint, then wait until the next setpoint is due: a loop with one such call runs at `freq`.

        att: roll, pitch, yaw [rad] (3,) for att_type "euler"; q_nb wxyz (4,) for att_type "quaternion".
        thrust: [N], clamped to the thrust that the vehicle can produce. freq: [Hz].
        """
        self._run(self.steps.att_thrust(att, att_type, thrust, freq))

    def set_ang_vel_thrust(self, ang_vel: ArrayLike, thrust: ArrayLike, freq: ArrayLike) -> None:
        """Send a setpoint of body rates and thrust, then wait until the next one is due: a loop with one such call runs at `freq`.

        ang_vel: body rates [rad/s] [FRD] (3,). thrust: [N], clamped to the thrust that the vehicle can
        produce. freq: [Hz].
        """
        self._run(self.steps.ang_vel_thrust(ang_vel, thrust, freq))

    def set_act(self, group: int, output: ArrayLike, freq: ArrayLike) -> None:
        """Send an actuator setpoint, then wait until the next setpoint is due: a loop with one such call runs at `freq`.

        group: mixer group 0..3. output: up to 8 numbers -1..1 [-]. freq: [Hz].
        Only PX4 up to v1.13 accepts such setpoints. Raises CommandRefusedError for other autopilots.
        """
        self._run(self.steps.act(group, output, freq))

    @property
    def encoder(self) -> Encoder:
        """Encoder that creates setpoint messages for the vehicle, to be sent with `send`."""
        return self.control.encoder

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send a setpoint and return at once. Raises OffboardLostError if the program no longer controls the vehicle."""
        self.control.send(message)

    def hold_until(self, done: Callable[[], bool], timeout: ArrayLike) -> bool:
        """Wait until `done` returns true, at most `timeout` [s]. Return False after the timeout, else True.

        In OFFBOARD the vehicle holds its position while it waits.
        """
        return bool(self._run(self.control.wait_until(done, duration_s(timeout))))

    def chores(self) -> None:
        """Receive data, and send the program's heartbeat to the vehicle if it is due.

        In lockstep a vehicle does so while the program sleeps on the vehicle's clock. A program of a `Fleet` sleeps on the
        fleet's clock instead, so the fleet calls this method.
        """
        self._connection.chores()

    def close(self) -> None:
        """Close the connection. No command is sent: a vehicle in the air enters its offboard failsafe."""
        self._connection.close()
        self._heartbeat.close()
        self._barrier.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self, steps: Steps[T]) -> T:
        return run(steps, self.clock)
