"""ULog of the built-in autopilot: the log that PX4 writes, with PX4's topics, fields and rates."""
