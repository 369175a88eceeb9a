"""Core of the copilot: checks the safety rules and selects commands, without sockets or clocks.

It receives datagrams, poses and the time, and returns datagrams and events.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import FORCE_ARM_DISARM
from arena.copilot.braking import BrakingLimits, predict_stops
from arena.copilot.escalation import Escalation, VehicleStatus, may_end
from arena.copilot.fleet_state import FleetState, Mask, Violation
from arena.copilot.rules import RuleChecker
from arena.copilot.settings import STEP_HZ, Rules, Step, Vehicle
from arena.copilot.tracks import LATE_S, Tracks
from arena.copilot.vehicle_state import VehicleStates
from arena.mocap.client import CapturedFrame, StreamLateness
from arena.portable_math import norm
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Buffer
from arena.wire.mavlink_ids import COPILOT
from arena.wire.mavlink_minimal import result_words
from arena.wire.px4_mode import mode_numbers

_SILENT_S = 3.0
_PROMPT_S = 0.1  # a frame that is later is late
_YOUNG_S = 0.3  # an older pose gives no position; the rule `pose_age` has its own limit
_TARGET_S, _SETTLED_S = 0.5, 0.3
_ESTIMATE_S = 0.5
_BATTERY_S = 5.0
_GRACE_S = 2.0  # for the handshake with motion capture after a start


@dataclass(frozen=True, kw_only=True)
class Output:
    """Result of one copilot step: commands to send, and lines for the event log.

    events: lines for the event log

    frames: (row of the vehicle, MAVLink frames), to be sent through the router and on the panic link.
    renewals: (row of the vehicle, MAVLink frames), to be sent through the router only.
    """

    frames: tuple[tuple[int, tuple[bytes, ...]], ...] = ()
    renewals: tuple[tuple[int, tuple[bytes, ...]], ...] = ()
    events: tuple[str, ...] = ()


class Copilot:
    """Core of the copilot: checks all rules at each step, and selects the commands to the vehicles.

    Pass in data with `on_frames` and `on_datagram`, and call `step` 50 times a second. In every method, `now`
    is the time [s] of the same clock.
    """

    def __init__(self, rules: Rules, vehicles: Sequence[Vehicle], now: float) -> None:
        self.vehicles, self.rules = tuple(vehicles), rules
        self.tracks, self.states = Tracks([v.body for v in vehicles]), VehicleStates([v.id for v in vehicles])
        self.checker = RuleChecker(rules, vehicles)
        self.escalations = [Escalation(name=v.name, rules=rules) for v in vehicles]
        self.orders: Counter[str] = Counter()
        self.closest_m = math.inf
        self._codec = Codec(COPILOT.system, COPILOT.component)
        self._limits = _limits(vehicles)
        self._began = now
        self._streams: dict[int, StreamLateness] = {}  # by motion-capture server
        self._silent: set[int] = set()
        self._without_landed_state: dict[int, float] = {}  # row -> armed without a landed state since [s]
        self._without_velocity: dict[int, float] = {}  # row -> flying without a velocity since [s]
        self._meeting: set[tuple[int, int]] = set()
        self._refused: set[tuple[int, int, int]] = set()

    def on_frames(self, frames: Iterable[CapturedFrame], now: float, server: int = 0) -> None:
        """Store the poses from frames of motion capture.

        server: index of the motion-capture server that sent the frames
        """
        stream = self._streams.setdefault(server, StreamLateness(_PROMPT_S))
        for frame in frames:
            late = stream.measure(frame, now)
            if math.isfinite(late):
                for pose in frame.poses:
                    self.tracks.on_pose(pose.body, pose.p_n, pose.q_nb, frame.time_s, now, late)

    def on_datagram(self, row: int | None, data: Buffer, now: float) -> None:
        """Store the vehicle states and the heartbeats of user programs that a received datagram contains.

        row: vehicle from whose tools port the datagram came, None for any other sender.
        """
        self.states.on_datagram(row, data, now)

    def heartbeat(self) -> bytes:
        """Return the copilot's HEARTBEAT message, which keeps its connections to the MAVLink router alive.

        The router drops clients that are silent. Send the message once a second to the tools port of each vehicle, which is
        the UDP port of the router for clients.
        """
        return self._codec.onboard_heartbeat()

    def step(self, now: float) -> Output:
        """Check all rules. Return the commands to send and the events of this step."""
        fleet = self.fleet_state(now)
        events = [*self._report_silence(now), *self._report_unwatched(fleet), *self._report_refusals()]
        violations = self.checker.violations(fleet)
        events += self._report_meetings(fleet)
        self.closest_m = min(self.closest_m, self.checker.found.closest)
        frames: list[tuple[int, tuple[bytes, ...]]] = []
        renewals: list[tuple[int, tuple[bytes, ...]]] = []
        for row, escalation in enumerate(self.escalations):
            own = [v for v in violations if v.row == row]
            decision = escalation.decide(own, self._status(row, bool(fleet.flying[row]), now), now)
            events += decision.events
            if decision.send is None:
                continue
            to_send = row, tuple(self._frames(row, decision.send))
            (renewals if decision.renews else frames).append(to_send)
            self.orders[decision.send] += not decision.renews
        return Output(frames=tuple(frames), renewals=tuple(renewals), events=tuple(events))

    @property
    def flying(self) -> Mask:
        """Mask of the vehicles that report that they are armed and in the air.

        A vehicle that has sent no message is not in the mask.
        """
        return np.array(
            [a is True and g is False for a, g in zip(self.states.armed, self.states.landed, strict=True)],
            np.bool_,
        )

    def any_armed(self, *, simulated: bool) -> bool:
        """Return whether any simulated vehicle is armed; with `simulated=False`, any real vehicle."""
        return any(
            a is True
            for a, v in zip(self.states.armed, self.vehicles, strict=True)
            if v.simulated == simulated
        )

    @property
    def missing(self) -> list[str]:
        """Names of the simulated vehicles of which no heartbeat or no captured pose has arrived yet.

        A vehicle without motion capture needs no pose.
        """
        present = np.isfinite(self.states.heartbeat_at) & (
            np.isfinite(self.tracks.seen_at) | ~np.array([v.poses for v in self.vehicles])
        )
        return [v.name for v, there in zip(self.vehicles, present, strict=True) if v.simulated and not there]

    def fleet_state(self, now: float) -> FleetState:
        """Return the state of all vehicles at time `now` [s]."""
        states, tracks = self.states, self.tracks
        p_n, age = tracks.positions(now), now - np.maximum(tracks.seen_at, self._began + _GRACE_S)
        young = now - tracks.seen_at
        v_n, moving = tracks.velocities()
        tilt, lean = tracks.tilt_and_acceleration()
        placed = (young <= _YOUNG_S) & np.isfinite(p_n).all(1)
        p_n = np.where(placed[:, None], p_n, 0.0)
        v_n = np.where((placed & moving)[:, None], v_n, 0.0)
        flying = self.flying
        offboard = np.array([mode == "OFFBOARD" for mode in states.mode], np.bool_)
        late = np.where(placed, young, 0.0) + self.rules.latency_s + LATE_S + 1.0 / STEP_HZ
        aimed = offboard & (now - states.target_at <= _TARGET_S)
        return FleetState(
            now=now,
            flying=flying,
            placed=placed,
            moving=moving & placed,
            p_n=p_n,
            v_n=v_n,
            tilt=np.where(placed, tilt, 0.0),
            open=flying
            & np.array(
                [may_end(m, h.order) for m, h in zip(states.mode, self.escalations, strict=True)], np.bool_
            ),
            held=np.array([h.held for h in self.escalations], np.bool_),
            pose_age=age,
            stop=predict_stops(p_n, v_n, np.where(placed[:, None], lean, 0.0), late, self._limits),
            target=np.where(aimed[:, None], states.target, np.nan),
            settled=aimed & (now - states.target_since >= _SETTLED_S),
            off=np.where(
                now - states.estimate_at <= _ESTIMATE_S, tracks.distance_to_track(states.estimate), np.nan
            ),
            battery=np.where(now - states.battery_at <= _BATTERY_S, states.battery, np.nan),
            offboard=offboard,
            silent_s=np.where(
                np.isfinite(states.program_heartbeat_at), now - states.program_heartbeat_at, np.nan
            ),
        )

    def _status(self, row: int, flying: bool, now: float) -> VehicleStatus:
        return VehicleStatus(
            flying=flying,
            mode=self.states.mode[row],
            fresh=bool(now - self.states.heartbeat_at[row] <= _SILENT_S),
        )

    def _report_silence(self, now: float) -> Iterator[str]:
        for row, vehicle in enumerate(self.vehicles):
            silent = now - self.states.heartbeat_at[row] > _SILENT_S
            if silent and row not in self._silent and np.isfinite(self.states.heartbeat_at[row]):
                self._silent.add(row)
                word = f"{self.states.mode[row]}, {'armed' if self.states.armed[row] else 'disarmed'}"
                yield f"{vehicle.name}: no heartbeat for {_SILENT_S:g} s (last: {word}); monitored by motion capture only"
            elif not silent and row in self._silent:
                self._silent.discard(row)
                yield f"{vehicle.name}: heartbeat received again"

    def _report_unwatched(self, m: FleetState) -> Iterator[str]:
        """Yield a warning for each vehicle whose data are missing, so that rules cannot be checked."""
        for row, vehicle in enumerate(self.vehicles):
            armed, landed = self.states.armed[row], self.states.landed[row]
            if _lasted(self._without_landed_state, row, armed is True and landed is None, m.now):
                yield f"{vehicle.name}: armed, but it does not report whether it is in the air (EXTENDED_SYS_STATE): NOT MONITORED"
            if _lasted(
                self._without_velocity,
                row,
                bool(m.flying[row] and m.placed[row] and not m.moving[row]),
                m.now,
            ):
                yield (
                    f"{vehicle.name}: too few poses, or poses without times, so its velocity is unknown: it will NOT be stopped before "
                    "the fence or other vehicles"
                )

    def _report_refusals(self) -> Iterator[str]:
        for refusal in self.states.refusals:
            if refusal not in self._refused:
                self._refused.add(refusal)
                row, _, result = refusal
                yield f"{self.vehicles[row].name}: the autopilot refused a command: {result_words(result)}; retrying"
        self.states.refusals.clear()

    def _report_meetings(self, m: FleetState) -> Iterator[str]:
        """Yield one event for each new pair of vehicles that fly to almost the same target position."""
        meeting = set(self.checker.found.meeting) if self.rules.on("separation") else set()
        for first, second in sorted(meeting - self._meeting):
            north, east, down = m.target[second]
            apart = norm(m.target[second] - m.target[first])
            yield (
                f"{self.vehicles[second].name} yields to {self.vehicles[first].name}: both are commanded to about "
                f"N {north:.1f} E {east:.1f} D {down:.1f}, {apart:.2f} m apart"
            )
        self._meeting = meeting

    def _frames(self, row: int, step: Step) -> Iterator[bytes]:
        if step == "terminate":
            yield self._command(row, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, FORCE_ARM_DISARM)
        else:
            main, sub = mode_numbers("AUTO.LOITER" if step == "hold" else "AUTO.LAND")
            yield self._command(
                row, mavlink.MAV_CMD_DO_SET_MODE, float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), main, sub
            )
        yield self._command(row, mavlink.MAV_CMD_REQUEST_MESSAGE, float(mavlink.MAVLINK_MSG_ID_HEARTBEAT))

    def _command(self, row: int, number: int, *params: float) -> bytes:
        filled = (*params, *(0.0,) * (7 - len(params)))
        return self._codec.pack(
            mavlink.MAVLink_command_long_message(self.vehicles[row].id, 1, number, 0, *filled)
        )

    def stats(self) -> dict[str, Any]:
        """Return the counters of the copilot for the summary of the run."""
        closest = {} if math.isinf(self.closest_m) else {"closest_m": round(self.closest_m, 2)}
        given = {f"sent {step}": n for step, n in self.orders.items()}
        received = {f"received {what}": n for what, n in self.states.counts.items()}
        return {
            **closest,
            **given,
            **received,
            "poses repeated": self.tracks.repeated,
            "tracks restarted": self.tracks.restarted,
        }


def _lasted(since: dict[int, float], row: int, so: bool, now: float) -> bool:
    """Return True once, as soon as a condition has been true for more than `_SILENT_S` [s] without interruption.

    Later calls return False until the condition has been false.
    since: row of the vehicle -> start time of the condition [s], updated here. so: whether the condition is true now.
    """
    if not so:
        since.pop(row, None)
    elif now - since.setdefault(row, now) > _SILENT_S:
        since[row] = math.inf
        return True
    return False


def _limits(vehicles: Sequence[Vehicle]) -> BrakingLimits:
    return BrakingLimits(
        **{
            key: np.array([getattr(v, key) for v in vehicles], dtype=np.float64)
            for key in ("accel", "jerk", "up", "down")
        }
    )


__all__ = ["Copilot", "Output", "Violation"]
