"""Facts about PX4's parameters: names, types, ranges, defaults and meanings by version."""
