"""Flying a scenario: the running arena, its observer and the actions on it."""
