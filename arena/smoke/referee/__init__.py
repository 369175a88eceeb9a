"""The referee of a smoke flight: receives observations, returns the actions to carry out and a verdict. Pure."""
