"""Trajectories: pure functions of time that return position, velocity and acceleration.

They send nothing.

A trajectory is any object with `duration_s` and `at(t)`. All vectors are NED, in metres and seconds.
"""

from arena.trajectories.csv_file import read_csv
from arena.trajectories.curves import Circle, Lissajous
from arena.trajectories.letters import letter_points, word_points
from arena.trajectories.minimum_snap import MinimumSnap, segment_times
from arena.trajectories.setpoint_list import SetpointList
from arena.trajectories.straight_line import StraightLine
from arena.trajectories.time_optimal import Limits, TimeOptimal
from arena.trajectories.trajectory import Moved, Reference, Sampled, Trajectory, from_rest, positions_along

__all__ = [
    "Circle",
    "Limits",
    "Lissajous",
    "MinimumSnap",
    "Moved",
    "Reference",
    "Sampled",
    "SetpointList",
    "StraightLine",
    "TimeOptimal",
    "Trajectory",
    "from_rest",
    "letter_points",
    "positions_along",
    "read_csv",
    "segment_times",
    "word_points",
]
