"""Replacements for the libraries of the ISR Flying Arena thesis: old programs need only new import lines.

The programs were written for the thesis's class `UAV`, with ROS 1 and MAVROS, or with MAVSDK.

    import rospy                                 ->  from arena.compat import rospy
    from uav_mavros import UAV                   ->  from arena.compat.uav_mavros import UAV
    from uav_mavsdk import UAV                   ->  from arena.compat.uav_mavsdk import UAV
    from geometry_msgs.msg import PoseStamped    ->  from arena.compat.messages import PoseStamped
    from std_msgs.msg import Header              ->  from arena.compat.messages import Header

The import of this package changes `sys.argv` to the arguments that the thesis's launcher passed, see `command_line`.
"""

from arena.compat import command_line as _command_line

_command_line.translate()
