"""Program in the thesis's style: a second thread publishes the reference at 30 Hz by the simulation clock."""

import sys
import threading

import numpy as np

from arena.compat import rospy
from arena.compat.messages import Header, PoseStamped
from arena.compat.uav_mavros import UAV

place = np.array([[0.0], [0.0], [-1.2]])


def publish():
    to_log = rospy.Publisher(sys.argv[1] + "/mavros/waypoints/position", PoseStamped, queue_size=1)
    pose = PoseStamped()
    pose.header = Header()
    rate = rospy.Rate(30)
    while True:
        pose.header.stamp = rospy.Time.now()
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = place[1], place[0], -place[2]
        to_log.publish(pose)
        rate.sleep()


if __name__ == "__main__":
    rospy.init_node("two_threads", anonymous=True)
    uav = UAV(*sys.argv[1:7])
    place = uav.ekf.pos + np.array([[float(sys.argv[7])], [0.0], [-1.2]])
    threading.Thread(target=publish, daemon=True).start()
    uav.start_offboard_mission()
    uav.set_pos_yaw(place, uav.ekf.att_euler[2], 4)
    began = rospy.get_time()
    while rospy.get_time() - began < 2:
        uav.set_vel_yaw(0.8 * (place - uav.ekf.pos), 0.0, 50)
    uav.auto_land()
