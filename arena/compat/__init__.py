"""Programs written for the class `UAV` of the ISR Flying Arena thesis (ROS 1, MAVROS or MAVSDK) fly with changed imports only.

    import rospy                                 ->  from arena.compat import rospy
    from uav_mavros import UAV                   ->  from arena.compat.uav_mavros import UAV
    from uav_mavsdk import UAV                   ->  from arena.compat.uav_mavsdk import UAV
    from geometry_msgs.msg import PoseStamped    ->  from arena.compat.messages import PoseStamped
    from std_msgs.msg import Header              ->  from arena.compat.messages import Header

The import of this package changes `sys.argv` to the arguments that the thesis's launcher passed, see `command_line`.
"""

from arena.compat import command_line as _command_line

_command_line.translate()
