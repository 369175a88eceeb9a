"""One YAML file becomes a flying arena."""

__version__ = "0.1.0"
