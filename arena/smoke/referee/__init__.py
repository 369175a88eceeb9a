"""The referee of a smoke flight: observations in, actions and a verdict out. Pure."""
