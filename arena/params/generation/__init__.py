"""Generation of PX4 parameters from the requirements of an arena."""
