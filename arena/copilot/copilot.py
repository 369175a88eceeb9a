"""The copilot's core: datagrams, poses and time in; datagrams and sentences out. No sockets, no clocks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import FORCE_ARM_DISARM
from arena.copilot.braking import Limits, stops
from arena.copilot.escalation import Escalation, Present, may_end
from arena.copilot.fleet_state import Broken, Mask, Moment
from arena.copilot.rules import Judge
from arena.copilot.settings import Rules, Step, Vehicle
from arena.copilot.tracks import LATE_S, Tracks
from arena.copilot.vehicle_state import COMPONENT, SYSTEM, Known
from arena.mocap.client import CapturedFrame
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Buffer
from arena.wire.mavlink_minimal import result_words
from arena.wire.px4_mode import mode_numbers

STEP_HZ = 50.0
_SILENT_S = 3.0
_YOUNG_S = 0.3  # a pose older than this says nothing of a place any more; `pose_age` has its own word on it
_TARGET_S, _SETTLED_S = 0.5, 0.3
_ESTIMATE_S = 0.5
_BATTERY_S = 5.0
_GRACE_S = 2.0  # the capture system's handshake, after a start


@dataclass(frozen=True, kw_only=True)
class Output:
    """to: rows -> frames, for the router and for the autopilot itself. events: sentences."""

    frames: tuple[tuple[int, tuple[bytes, ...]], ...] = ()
    events: tuple[str, ...] = ()


class Copilot:
    """Feed it with `see` and `hear`, ask it with `step` fifty times a second. now: [s], always of the same clock."""

    def __init__(self, rules: Rules, vehicles: Sequence[Vehicle], now: float) -> None:
        self.vehicles, self.rules = tuple(vehicles), rules
        self.tracks, self.known = Tracks([v.body for v in vehicles]), Known([v.id for v in vehicles])
        self.judge = Judge(rules, vehicles)
        self.helms = [Escalation(name=v.name, rules=rules) for v in vehicles]
        self.orders: Counter[str] = Counter()
        self.closest_m = math.inf
        self._codec = Codec(SYSTEM, COMPONENT)
        self._limits = _limits(vehicles)
        self._began = now
        self._silent: set[int] = set()
        self._groundless: dict[
            int, float
        ] = {}  # row -> since when it is armed, and says nothing of the ground
        self._speedless: dict[
            int, float
        ] = {}  # row -> since when it flies, and is captured without a velocity
        self._meeting: set[tuple[int, int]] = set()
        self._refused: set[tuple[int, int, int]] = set()

    def see(self, frames: Iterable[CapturedFrame], now: float) -> None:
        """What the cameras saw."""
        for frame in frames:
            for pose in frame.poses:
                self.tracks.see(pose.body, pose.p_n, pose.q_nb, frame.time_s, now)

    def hear(self, row: int | None, data: Buffer, now: float) -> None:
        """A datagram from the tools port of that row, or from anybody (None)."""
        self.known.hear(row, data, now)

    def heartbeat(self) -> bytes:
        """Once a second to every tools port: the router forgets who is silent."""
        return self._codec.onboard_heartbeat()

    def step(self, now: float) -> Output:
        """Look, judge, order."""
        moment = self.moment(now)
        events = [*self._silences(now), *self._unwatched(moment), *self._refusals()]
        broken = self.judge.broken(moment)
        events += self._meetings(moment)
        self.closest_m = min(self.closest_m, self.judge.found.closest)
        frames: list[tuple[int, tuple[bytes, ...]]] = []
        for row, helm in enumerate(self.helms):
            own = [b for b in broken if b.row == row]
            acts = helm.decide(own, self._present(row, bool(moment.flying[row]), now), now)
            events += acts.said
            if acts.send is not None:
                frames.append((row, tuple(self._frames(row, acts.send))))
                self.orders[acts.send] += 1
        return Output(frames=tuple(frames), events=tuple(events))

    @property
    def flying(self) -> Mask:
        """Armed and in the air, each by its own last word; what was never heard does not fly for us."""
        return np.array(
            [a is True and g is False for a, g in zip(self.known.armed, self.known.landed, strict=True)],
            np.bool_,
        )

    def any_armed(self, *, simulated: bool) -> bool:
        return any(
            a is True
            for a, v in zip(self.known.armed, self.vehicles, strict=True)
            if v.simulated == simulated
        )

    @property
    def unheard(self) -> list[str]:
        """Simulated vehicles never heard, or never captured where they should be."""
        heard = np.isfinite(self.known.heart_at) & (
            np.isfinite(self.tracks.seen_at) | ~np.array([v.poses for v in self.vehicles])
        )
        return [v.name for v, there in zip(self.vehicles, heard, strict=True) if v.simulated and not there]

    def moment(self, now: float) -> Moment:
        known, tracks = self.known, self.tracks
        p_n, age = tracks.places(now), now - np.maximum(tracks.seen_at, self._began + _GRACE_S)
        young = now - tracks.seen_at
        v_n, moving = tracks.velocities()
        tilt, lean = tracks.leans()
        placed = (young <= _YOUNG_S) & np.isfinite(p_n).all(1)
        p_n = np.where(placed[:, None], p_n, 0.0)
        v_n = np.where((placed & moving)[:, None], v_n, 0.0)
        flying = self.flying
        offboard = np.array([mode == "OFFBOARD" for mode in known.mode], np.bool_)
        late = np.where(placed, young, 0.0) + self.rules.latency_s + LATE_S + 1.0 / STEP_HZ
        aimed = offboard & (now - known.target_at <= _TARGET_S)
        return Moment(
            now=now,
            flying=flying,
            placed=placed,
            moving=moving & placed,
            p_n=p_n,
            v_n=v_n,
            tilt=np.where(placed, tilt, 0.0),
            open=flying
            & np.array([may_end(m, h.order) for m, h in zip(known.mode, self.helms, strict=True)], np.bool_),
            held=np.array([h.held for h in self.helms], np.bool_),
            pose_age=age,
            stop=stops(p_n, v_n, np.where(placed[:, None], lean, 0.0), late, self._limits),
            target=np.where(aimed[:, None], known.target, np.nan),
            settled=aimed & (now - known.target_since >= _SETTLED_S),
            off=np.where(now - known.estimate_at <= _ESTIMATE_S, tracks.off(known.estimate), np.nan),
            battery=np.where(now - known.battery_at <= _BATTERY_S, known.battery, np.nan),
            offboard=offboard,
            silent_s=np.where(np.isfinite(known.beat_at), now - known.beat_at, np.nan),
        )

    def _present(self, row: int, flying: bool, now: float) -> Present:
        return Present(
            flying=flying, mode=self.known.mode[row], fresh=bool(now - self.known.heart_at[row] <= _SILENT_S)
        )

    def _silences(self, now: float) -> Iterator[str]:
        for row, vehicle in enumerate(self.vehicles):
            silent = now - self.known.heart_at[row] > _SILENT_S
            if silent and row not in self._silent and np.isfinite(self.known.heart_at[row]):
                self._silent.add(row)
                word = f"{self.known.mode[row]}, {'armed' if self.known.armed[row] else 'disarmed'}"
                yield f"{vehicle.name}: not heard for {_SILENT_S:g} s; the cameras alone tell of it now, its last word was {word}"
            elif not silent and row in self._silent:
                self._silent.discard(row)
                yield f"{vehicle.name}: heard again"

    def _unwatched(self, m: Moment) -> Iterator[str]:
        """Rules that do not hold because what they need is not known: a person must hear of it."""
        for row, vehicle in enumerate(self.vehicles):
            armed, landed = self.known.armed[row], self.known.landed[row]
            if _lasts(self._groundless, row, armed is True and landed is None, m.now):
                yield f"{vehicle.name}: armed, but it does not say whether it is in the air (EXTENDED_SYS_STATE): NOT WATCHED"
            if _lasts(
                self._speedless, row, bool(m.flying[row] and m.placed[row] and not m.moving[row]), m.now
            ):
                yield (
                    f"{vehicle.name}: captured too seldom, or without times, to know its velocity: it will NOT be stopped before "
                    "the fence nor before others"
                )

    def _refusals(self) -> Iterator[str]:
        for refusal in self.known.refusals:
            if refusal not in self._refused:
                self._refused.add(refusal)
                row, _, result = refusal
                yield f"{self.vehicles[row].name}: an order was refused: {result_words(result)}; trying on"
        self.known.refusals.clear()

    def _meetings(self, m: Moment) -> Iterator[str]:
        """Vehicles commanded to one place, told once as long as they are."""
        meeting = set(self.judge.found.meeting) if self.rules.on("separation") else set()
        for first, second in sorted(meeting - self._meeting):
            north, east, down = m.target[second]
            apart = float(np.linalg.norm(m.target[second] - m.target[first]))
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
        """Figures for the summary."""
        closest = {} if math.isinf(self.closest_m) else {"closest_m": round(self.closest_m, 2)}
        given = {f"sent {step}": n for step, n in self.orders.items()}
        heard = {f"heard {what}": n for what, n in self.known.counts.items()}
        return {
            **closest,
            **given,
            **heard,
            "poses repeated": self.tracks.repeated,
            "tracks restarted": self.tracks.restarted,
        }


def _lasts(since: dict[int, float], row: int, so: bool, now: float) -> bool:
    """True once, when it has been so for _SILENT_S."""
    if not so:
        since.pop(row, None)
    elif now - since.setdefault(row, now) > _SILENT_S:
        since[row] = math.inf
        return True
    return False


def _limits(vehicles: Sequence[Vehicle]) -> Limits:
    return Limits(
        **{
            key: np.array([getattr(v, key) for v in vehicles], dtype=np.float64)
            for key in ("accel", "jerk", "up", "down")
        }
    )


__all__ = ["Broken", "Copilot", "Output"]
