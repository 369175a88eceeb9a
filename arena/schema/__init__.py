"""Reads and checks arena.yaml, merges it with defaults and profiles, and returns an `Arena`."""

from arena.schema.arena import Arena, Origin, Program, Px4, Vehicle
from arena.schema.library import data_folder, load_profile, profile_names
from arena.schema.load import load_arena
from arena.schema.profile import Profile

__all__ = [
    "Arena",
    "Origin",
    "Profile",
    "Program",
    "Px4",
    "Vehicle",
    "data_folder",
    "load_arena",
    "load_profile",
    "profile_names",
]
