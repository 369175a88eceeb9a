"""ULog files of the built-in autopilot, with PX4's topics, fields and rates."""
