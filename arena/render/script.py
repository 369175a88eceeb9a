"""Content of all pictures of a film as data: cameras, texts, and the state of each vehicle. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from arena.geometry import Array
from arena.render import style
from arena.render.camera import Camera
from arena.render.picture import Body, draw_picture
from arena.render.sources import Recorded
from arena.render.tracks import Moments, Track, at
from arena.render.views import View, cameras

TRAIL_HZ = 15.0
_STROBES = 14  # vehicles in a picture of a whole flight, at most about this many


@dataclass(frozen=True, kw_only=True)
class Actor:
    """Vehicle in a film, with its colour and its state in each picture.

    trail_n: its positions [m] [NED] (k, 3), one every 1 / TRAIL_HZ seconds. They begin `trail_s` before the first picture.
    """

    track: Track
    colour: style.Colour
    moments: Moments
    trail_n: Array


@dataclass(frozen=True, kw_only=True)
class Script:
    """Everything that is needed to draw the f pictures of a film, one by one.

    recorded: the recorded flights.  times: time of each picture [s] (f,).  cameras: one per picture.  actors: the vehicles.
    speed: flight seconds per second of film.  trail_s: each picture shows the path of a vehicle for this time before it [s].
    """

    recorded: Recorded
    times: Array
    cameras: Sequence[Camera]
    actors: Sequence[Actor]
    speed: float
    trail_s: float

    def picture(self, k: int) -> Image.Image:
        """Draw picture number k of the film."""
        bodies = [self._body(actor, k) for actor in self.actors]
        return draw_picture(self.recorded.room, self.cameras[k], bodies, index=k, heading=self.heading(k))

    def heading(self, k: int) -> list[str]:
        """Return the text lines at the top left of picture k: title, time, and number of vehicles per flight mode."""
        clock = f"{self.times[k]:.1f} s"
        if self.speed != 1.0:
            clock += f"   {self.speed:g}x"
        modes = Counter(_state(a.moments, k) for a in self.actors)
        crowd = "   ".join(f"{count} {mode}" for mode, count in modes.most_common(3))
        return [self.recorded.title, clock, crowd] if len(self.actors) > 4 else [self.recorded.title, clock]

    def _body(self, actor: Actor, k: int) -> Body:
        now, last = actor.moments, round((self.times[k] - self.times[0] + self.trail_s) * TRAIL_HZ)
        trail = actor.trail_n[max(0, last - round(self.trail_s * TRAIL_HZ)) : last]
        return Body(
            airframe=actor.track.airframe,
            colour=actor.colour,
            p_n=now.p_n[k],
            q_nb=now.q_nb[k],
            ref_n=now.ref_n[k] if np.isfinite(now.ref_n[k]).all() else None,
            trail_n=np.concatenate([trail, now.p_n[k : k + 1]]),
            label=(actor.track.name, _state(now, k)),
            spinning=bool(now.armed[k]),
            outdated=not now.known[k],
        )


def picture_times(start_s: float, end_s: float, fps: float, speed: float) -> Array:
    """Return the flight time of each picture [s] (f,). There is at least one picture.

    The times go from start_s up to end_s in steps of `speed / fps`.
    """
    count = int(np.floor((end_s - start_s) * fps / speed + 1e-9)) + 1
    return np.asarray(start_s + np.arange(max(count, 1)) * speed / fps)


def make_script(
    recorded: Recorded, times: Array, view: View, size: tuple[int, int], *, speed: float, trail_s: float
) -> Script:
    """Return the content of all pictures of a film. Draws no picture.

    recorded: the recorded flights.  times: time of each picture [s] (f,).  view: where the camera is.  size: width, height [px].
    speed: flight seconds per second of film.  trail_s: each picture shows the path of a vehicle for this time before it [s].
    """
    grid = times[0] - trail_s + np.arange(round((times[-1] - times[0] + trail_s) * TRAIL_HZ) + 1) / TRAIL_HZ
    colours = style.vehicle_colours(len(recorded.tracks))
    actors = [
        Actor(track=t, colour=c, moments=at(t, times), trail_n=at(t, grid).p_n)
        for t, c in zip(recorded.tracks, colours, strict=True)
    ]
    return Script(
        recorded=recorded,
        times=times,
        cameras=cameras(view, recorded.tracks, times, speed, size),
        actors=actors,
        speed=speed,
        trail_s=trail_s,
    )


def whole_flight(
    recorded: Recorded, start_s: float, end_s: float, view: View, size: tuple[int, int]
) -> Image.Image:
    """Draw one picture of a whole flight: full paths, and each vehicle at several times between start_s and end_s [s]."""
    count = max(1, _STROBES // len(recorded.tracks))
    times = np.linspace(start_s, end_s, count + 2)[1:-1]
    camera = cameras(view, recorded.tracks, np.array([start_s, end_s]), 1.0, size)[-1]
    grid = np.linspace(start_s, end_s, max(2, round((end_s - start_s) * TRAIL_HZ)))
    bodies = []
    for track, colour in zip(recorded.tracks, style.vehicle_colours(len(recorded.tracks)), strict=True):
        now, trail = at(track, times), at(track, grid).p_n
        for k in range(count):
            last = k == count - 1
            bodies.append(
                Body(
                    airframe=track.airframe,
                    colour=colour,
                    p_n=now.p_n[k],
                    q_nb=now.q_nb[k],
                    ref_n=None,
                    trail_n=trail if last else trail[:0],
                    label=(track.name,) if last else (),
                    spinning=bool(now.armed[k]),
                    outdated=not now.known[k],
                )
            )
    heading = [recorded.title, f"{start_s:.1f} to {end_s:.1f} s"]
    return draw_picture(recorded.room, camera, bodies, index=0, heading=heading)


def _state(now: Moments, k: int) -> str:
    """Return the state of a vehicle in picture k as text: the flight mode while it is armed, else `disarmed` or `state unknown`."""
    if now.armed[k]:
        return now.mode[k] or "armed"
    return "disarmed" if now.armed_known[k] else "state unknown"
