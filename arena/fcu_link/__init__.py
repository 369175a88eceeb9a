"""Link process of one flight controller: connects it with the MAVLink router and the pose forwarder.

The link process refuses arming of a real vehicle while a preflight check fails.
"""
