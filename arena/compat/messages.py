"""ROS messages with which a program of the ISR Flying Arena thesis publishes its wanted position."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Header:
    """Header of a ROS message. stamp: time of the message, see `arena.compat.rospy.Time`."""

    seq: int = 0
    stamp: object = None
    frame_id: str = ""


@dataclass
class Point:
    """Position [m]. A program may also assign arrays with one element."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Quaternion:
    """Attitude [-]. The scalar part is `w`."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class Pose:
    """Position [m] [ENU] and attitude."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseStamped:
    """Pose with a time stamp."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)
