"""Generation of the parameters of one PX4 version from an arena's requirements."""
