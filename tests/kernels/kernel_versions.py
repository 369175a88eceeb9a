"""The compiled and the interpreted version of a kernel module, in one process."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

import numpy as np
import pytest

import arena
import arena.kernels

needs_compiled = pytest.mark.skipif(
    arena.kernels.INTERPRETED is not None, reason=f"kernels are not compiled: {arena.kernels.INTERPRETED}"
)


def interpreted_modules(*names: str) -> dict[str, ModuleType]:
    """Import kernel modules from their Python sources. The kernels that this process uses stay as they are."""
    in_use = {name: module for name, module in sys.modules.items() if name.startswith("arena.kernels")}
    finders = list(sys.meta_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARENA_INTERPRETED", "1")
        for name in in_use:
            del sys.modules[name]
        try:
            return {name: importlib.import_module(f"arena.kernels.{name}") for name in names}
        finally:
            for name in [each for each in sys.modules if each.startswith("arena.kernels")]:
                del sys.modules[name]
            sys.modules.update(in_use)
            sys.meta_path[:] = finders
            arena.kernels = in_use["arena.kernels"]


def compiled_modules(*names: str) -> dict[str, ModuleType]:
    """Import kernel modules as this process uses them: compiled, in a test that `needs_compiled`."""
    return {name: importlib.import_module(f"arena.kernels.{name}") for name in names}


def arrays_of(law: object) -> dict[str, np.ndarray]:
    """Return the public arrays of a kernel object by name."""
    found = {name: getattr(law, name) for name in dir(law) if not name.startswith("_")}
    return {
        name: np.asarray(value)
        for name, value in found.items()
        if type(value).__name__ in ("memoryview", "_memoryviewslice")
    }
