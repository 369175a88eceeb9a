"""Kernels: compiled modules for the code that must be fast, such as physics and controllers. Pure.

Most kernels run in every step, and loop over the arrays of all vehicles.

A kernel is a plain Python module, and its .pxd file contains the C types for Cython. The compiled and the interpreted
module give the same results, bit for bit. Import a kernel as usual: it is the compiled module if all kernels are
compiled from the present sources, else the Python source, which is about fifty times slower.

`ARENA_INTERPRETED=1` selects the Python source, so that a debugger can step through the formulas.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.machinery import EXTENSION_SUFFIXES, ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

from arena.kernels.source_digest import compiled_names, kernel_names, source_digest, stored_digest

_FOLDER = Path(__file__).parent


def why_interpreted(folder: Path = _FOLDER) -> str | None:
    """Return why the kernels in a folder run as slow Python source; None if they run compiled.

    The text is a message for people: it names the reason and what to do.
    """
    if os.environ.get("ARENA_INTERPRETED", "0") not in ("", "0"):
        return "simulated flights are slow: ARENA_INTERPRETED selects the Python source of the kernels"
    suffix = EXTENSION_SUFFIXES[0]
    compiled = [folder / f"{name}{suffix}" for name in compiled_names(folder)]
    if not all(path.exists() for path in compiled):
        return (
            "simulated flights are slow: the kernels are not compiled. Install a C compiler and Python's headers "
            "(`apt install gcc python3-dev`), then install arena again"
        )
    digest = source_digest(folder)
    if any(stored_digest(path) != digest for path in compiled):
        return (
            "simulated flights are slow: the kernels have changed since they were compiled. "
            "Compile them: `python setup.py build_ext --inplace`"
        )
    return None


class _SourceFinder:
    """Import hook that makes Python load kernels from their source, and not from a compiled file.

    Its base class would import `importlib.abc`, which takes 5 ms.

    Without this hook, Python would prefer a compiled module, even if it was compiled from older source.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, name = fullname.rpartition(".")
        if package != __name__ or name not in kernel_names(_FOLDER):
            return None
        return spec_from_file_location(fullname, _FOLDER / f"{name}.py")


INTERPRETED = why_interpreted()
"""Why this process runs the Python source of the kernels, None if the kernels are compiled."""

if INTERPRETED:
    sys.meta_path.insert(0, _SourceFinder())
