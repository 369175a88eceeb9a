"""Digest (SHA-256) of the kernel sources, which shows whether the compiled kernels are up to date.

Each compiled kernel contains the digest of the sources from which it was compiled.

setup.py runs this file on its own, so it imports only the standard library.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

_MARK = "arena-kernel-sources:"


def kernel_names(folder: Path) -> list[str]:
    """Return the names of the kernels in a folder: Python modules that are compiled.

    They have a .pxd file beside the .py file.
    """
    return sorted(path.stem for path in folder.glob("*.pxd"))


def compiled_names(folder: Path) -> list[str]:
    """Return the names of all compiled modules in a folder: kernels and .pyx modules.

    A .pyx module has no Python source.
    """
    return sorted([*kernel_names(folder), *(path.stem for path in folder.glob("*.pyx"))])


def sources(folder: Path, name: str) -> list[Path]:
    """Return the source files of a compiled module; the first file is the one to compile."""
    found = [folder / f"{name}{suffix}" for suffix in (".pyx", ".py", ".pxd")]
    return [path for path in found if path.exists()]


def source_digest(folder: Path) -> str:
    """Return the SHA-256 of all kernel sources in a folder, as hexadecimal text."""
    digest = hashlib.sha256()
    for name in compiled_names(folder):
        for path in sources(folder, name):
            digest.update(f"{path.name}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def digest_as_c(name: str, digest: str) -> str:
    """Return C source that stores a digest in the compiled module `name`."""
    return f'const char arena_kernel_sources_{name}[] = "{_MARK}{digest}";\n'


def stored_digest(compiled: Path) -> str | None:
    """Return the digest that a compiled module contains; None if it contains none."""
    found = re.search(_MARK.encode() + rb"([0-9a-f]{64})", compiled.read_bytes())
    return found[1].decode() if found else None
