"""Generation of PX4 parameters from the requirements of an arena, for one PX4 version."""
