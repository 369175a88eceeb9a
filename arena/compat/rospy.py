"""Functions of `rospy` for programs of the ISR Flying Arena thesis, without ROS.

All times are those of the clock of the arena.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from arena.compat import thread_clocks
from arena.compat.messages import PoseStamped
from arena.compat.uav_mavros import VEHICLES
from arena.errors import InputError
from arena.geometry import ned_from_world

REFERENCE_TOPIC = "/mavros/waypoints/position"


class ROSInterruptException(Exception):
    """Exception that programs catch around their loop. It is never raised here."""


class Time:
    """Point in time [s] on the simulation clock, or Unix time if the program uses the wall clock."""

    def __init__(self, secs: float = 0.0) -> None:
        self._s = float(secs)

    @classmethod
    def now(cls) -> Time:
        return cls(thread_clocks.time_s())

    @classmethod
    def from_sec(cls, secs: float) -> Time:
        """Return a number of seconds as a `Time`."""
        return cls(secs)

    def to_sec(self) -> float:
        """Return the point in time as a number [s]."""
        return self._s

    @property
    def secs(self) -> int:
        """Whole seconds of the point in time, as in ROS."""
        return int(self._s)

    @property
    def nsecs(self) -> int:
        """Part of the time that is less than a second [ns], as in ROS."""
        return round(1e9 * (self._s - int(self._s)))


class Rate:
    """Timer for a loop with a fixed rate [Hz].

    The first period begins when the object is made.
    """

    def __init__(self, hz: float) -> None:
        self._rate = thread_clocks.clock().rate(float(hz))

    def sleep(self) -> None:
        """Sleep until the end of the current period of the loop."""
        self._rate.sleep()


class Publisher:
    """Publisher of the vehicle's wanted position, the only topic that can be published without ROS.

    The topic is `NAME/mavros/waypoints/position` with the name of the vehicle.

    Each message goes to the recorder, as `UAV.reference` does. Raises InputError for another topic.
    """

    def __init__(self, name: str, data_class: type[Any], queue_size: int = 1, **_options: Any) -> None:
        vehicle, topic, rest = name.strip("/").partition(REFERENCE_TOPIC)
        if not topic or rest or data_class is not PoseStamped:
            raise InputError(
                f"rospy.Publisher: the topic {name!r} cannot be published without ROS. Expected NAME{REFERENCE_TOPIC} with PoseStamped"
            )
        self._vehicle = vehicle

    def publish(self, message: PoseStamped) -> None:
        """Log the position in a ROS message [m] [ENU] as the wanted position of the vehicle.

        Nothing is logged before the `UAV` exists.
        """
        uav = VEHICLES.get(self._vehicle)
        if uav is not None:
            at = message.pose.position
            uav.reference(p=ned_from_world([float(np.squeeze(v)) for v in (at.x, at.y, at.z)]))


def Subscriber(name: str, *_arguments: Any, **_options: Any) -> None:
    """Raise InputError, because a program without ROS cannot subscribe to topics.

    The data are in the groups of `UAV`, such as `ekf.pos`.
    """
    raise InputError(
        f"rospy.Subscriber: the topic {name!r} cannot be read without ROS. Read the data of the UAV object, such as uav.ekf.pos"
    )


def init_node(name: str, *_arguments: Any, **_options: Any) -> None:
    """Do nothing: without ROS there are no nodes."""


def get_time() -> float:
    """Return the simulation time [s], or Unix time [s] if the program uses the wall clock."""
    return thread_clocks.time_s()


def sleep(duration: float) -> None:
    """Sleep for a duration [s]."""
    clock = thread_clocks.clock()
    clock.sleep_until(clock.now() + float(duration))


def is_shutdown() -> bool:
    """Return False always, because `arena` stops a program by a signal and not through ROS."""
    return False


def loginfo(text: str, *arguments: Any) -> None:
    """Print a formatted line to standard output, because there is no ROS log.

    text: format for the operator `%`. arguments: its values.
    """
    print(text % arguments if arguments else text, flush=True)


logwarn = logerr = loginfo
