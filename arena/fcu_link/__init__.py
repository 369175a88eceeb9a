"""The link process of one flight controller: connects the controller to the router and the pose forwarder.

The link process refuses arming of a real vehicle while a preflight check fails.
"""
