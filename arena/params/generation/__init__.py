"""Generation of PX4 parameters of one PX4 version from the requirements of an arena."""
