"""Emulated cameras, without sockets or clocks: compute measured frames from true poses.

Frame k is exposed at k / rate and sent one latency later. Every frame has new noise. Each body has its own random stream,
so another body does not change its noise. An occluded body is still sent, with its last pose and marked as not tracked,
because real systems do so. An injected delay is added to the latency. It does not change frames that are already exposed,
and frames keep their order.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from arena.geometry import quat_from_euler
from arena.kernels.arrays import array
from arena.kernels.pose_measurement import PoseMeasurement
from arena.mocap.emulator.interface import MeasuredBody, MeasuredFrame
from arena.wire.truth_rows import PER_VEHICLE

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

_STREAM = 180  # distinguishes these random streams from others with the same seed
_BLOCK = 64  # frames drawn at once
_CLOCK_STEP_S = 1e-6  # a clock that wakes by steps may return a time a little before the one requested


class EmulatedCameras:
    """Emulated cameras: compute frames from true poses, with noise, latency and injected faults.

    settings: configuration of the `mocap` process.
    delay_s: injected delay, added to the latency [s]; may change at any time.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.rate_hz, self.latency_s = float(settings["rate_hz"]), float(settings["latency_ms"]) * 1e-3
        self.delay_s = 0.0
        self._bodies = settings["bodies"]
        self._index = {str(b["name"]): i for i, b in enumerate(self._bodies)}
        self._rows = np.array([b["index"] for b in self._bodies], int)
        self._swapped: list[frozenset[str]] = []
        self._waiting: deque[MeasuredFrame] = deque()
        noise = settings["noise"]
        sigma_m, sigma_rad = float(noise["position_m"]), math.radians(float(noise["rotation_deg"]))
        self._shown_rows = self._rows.copy()  # rows of the truth after swapped bodies
        numbers = [int(b["number"]) for b in self._bodies]
        self._law = law = PoseMeasurement(numbers, self._shown_rows, _BLOCK, sigma_m, sigma_rad, PER_VEHICLE)
        self._offset_n, self._rotation, self._noise = map(array, (law.offset_n, law.rotation, law.noise))
        seed = int(settings["seed"])
        self._streams = [np.random.default_rng([seed, _STREAM, int(b["number"])]) for b in self._bodies]
        self._frames_left = 0
        self._occluded: set[str] = set()
        self._frozen: set[str] = set()
        self._last: list[MeasuredBody] = []

    @property
    def bodies(self) -> tuple[str, ...]:
        return tuple(self._index)

    # -- frames --------------------------------------------------------------------------------------------------------

    def exposure(self, number: int) -> float:
        """Return the simulation time of the exposure of frame `number` [s]."""
        return number / self.rate_hz

    def due(self, number: int) -> float:
        """Return the simulation time at which a frame must be measured or sent next [s].

        number: the next frame to measure. A frame is measured one latency after its exposure, because it
        cannot be sent earlier.
        """
        exposes = self.exposure(number) + self.latency_s
        return min(exposes, self.leaves_at(self._waiting[0])) if self._waiting else exposes

    def leaves_at(self, frame: MeasuredFrame) -> float:
        """Return the simulation time at which a frame is sent: exposure + latency + injected delay [s]."""
        return frame.exposed_s + self.latency_s + self.delay_s

    def enqueue(self, number: int, states: Floats) -> None:
        """Measure frame `number` and add it to the queue of frames to send.

        states: true states at the exposure, as a row of the truth page.

        Call it one latency after the exposure.
        """
        self._waiting.append(self.measure(number, states))

    def leaving(self, now: float) -> list[MeasuredFrame]:
        """Return the frames to send at time `now` [s], oldest first, and remove them from the queue."""
        frames = []
        while self._waiting and self.leaves_at(self._waiting[0]) <= now + _CLOCK_STEP_S:
            frames.append(self._waiting.popleft())
        return frames

    def measure(self, number: int, states: Floats) -> MeasuredFrame:
        """Return frame `number` as the cameras measure it, with noise and injected faults.

        states: true states at the exposure, as a row of the truth page.
        """
        bodies = self._law.measure(states, self._next_noise())
        if self._occluded or self._frozen:
            bodies = [self._with_faults(name, body) for name, body in zip(self._index, bodies, strict=True)]
        self._last = bodies
        return MeasuredFrame(number, self.exposure(number), tuple(bodies))

    def _next_noise(self) -> int:
        """Return the index of the noise values for the next frame. Draw new random values if all are used."""
        if not self._frames_left:
            for i, stream in enumerate(self._streams):
                self._noise[:, i] = stream.standard_normal((_BLOCK, 6))
            self._frames_left = _BLOCK
        self._frames_left -= 1
        return _BLOCK - 1 - self._frames_left

    def _with_faults(self, name: str, measured: MeasuredBody) -> MeasuredBody:
        """Return a measured pose with faults: an occluded or frozen body repeats its last pose."""
        last = self._last[self._index[name]] if self._last else measured
        if name in self._occluded:
            return last._replace(tracked=False)
        return last if name in self._frozen else measured

    # -- fault injection -----------------------------------------------------------------------------------------------

    def set_occluded(self, body: str, occluded: bool) -> None:
        """Inject or end the fault that the cameras do not see a body."""
        (self._occluded.add if occluded else self._occluded.discard)(body)

    def set_frozen(self, body: str, frozen: bool) -> None:
        """Inject or end the fault that a body stays tracked, but its measured pose no longer changes."""
        (self._frozen.add if frozen else self._frozen.discard)(body)

    def set_offset(self, body: str, offset_n: Sequence[float], yaw_rad: float) -> None:
        """Inject the fault that all measured poses of a body have an offset.

        offset_n: [m] [NED] (3,). yaw_rad: rotation about the vertical axis through the body, clockwise seen
        from above.
        """
        i = self._index[body]
        self._offset_n[i], self._rotation[i] = offset_n, quat_from_euler([0.0, 0.0, yaw_rad])

    def set_swapped(self, a: str, b: str, swapped: bool) -> None:
        """Inject or end the fault that two bodies have exchanged their poses."""
        pair = frozenset((a, b))
        self._swapped = [p for p in self._swapped if p != pair] + [pair] * swapped
        self._shown_rows[:] = self._rows
        for names in self._swapped:
            i, k = (self._index[name] for name in names)
            self._shown_rows[[i, k]] = self._shown_rows[[k, i]]
