"""Replacement of a file as a whole: a reader, or a computer after a power failure, has the old text or the new text."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def replace_file(path: Path, text: str) -> None:
    """Replace the text of a file, or create the file. Raises OSError if it cannot be written.

    A temporary file in the same folder gets the name of the file after its text has reached the disk.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with part.open("w") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise OSError(
            error.errno, error.strerror, str(path)
        ) from error  # it names the file, not the temporary file
