"""Generation of PX4 parameters from what an arena requires."""
