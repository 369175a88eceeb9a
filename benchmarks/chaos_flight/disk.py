"""A small disk for the run folders of one flight, which can be filled, and can let every write wait.

A tmpfs, or an ext4 file system in a file if writes must hang: `fsfreeze` then blocks them as a broken disk does. It is mounted in
the mount namespace of the flight (`mount_namespace`), so nothing of it is left when the flight has ended.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Self

SIZE_MB = 24
_NAMESPACES = {"root": ("unshare", "--mount"), "user": ("unshare", "--user", "--map-root-user", "--mount")}


def mount_namespace() -> str:
    """Return which mount namespace a flight can have: "root", "user" (no disk that hangs), or "" if the system allows none."""
    return next((kind for kind, command in _NAMESPACES.items() if _works([*command, "true"])), "")


def in_namespace(kind: str, command: Sequence[str]) -> list[str]:
    """Return the command, in a mount namespace of its own. kind: from `mount_namespace`."""
    return [*_NAMESPACES.get(kind, ()), *command]


class SmallDisk:
    """Disk of one flight.

    folder: where it is mounted.
    hung: writes wait now.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.hung = folder, False

    @classmethod
    def mount(cls, folder: Path, *, may_hang: bool) -> Self | None:
        """Mount a disk on a folder. Return None if the system does not allow it. may_hang: `hang` will be called."""
        folder.mkdir(parents=True, exist_ok=True)
        command = ["mount", "-t", "tmpfs", "-o", f"size={SIZE_MB}m", "chaos", str(folder)]
        if may_hang:
            image = folder.with_name(folder.name + ".ext4")
            with image.open("wb") as file:
                file.truncate(SIZE_MB << 20)
            if not _works(["mkfs.ext4", "-q", "-m", "0", str(image)]):
                return None
            command = ["mount", "-o", "loop", str(image), str(folder)]
        return cls(folder) if _works(command) else None

    def fill(self) -> bool:
        """Fill the disk to the last byte. Return whether it is full."""
        try:
            with (self.folder / "fill").open("ab", buffering=0) as file:
                for size in (1 << 16, 1):
                    with contextlib.suppress(OSError):
                        while file.write(b"x" * size) == size:
                            pass
        except OSError:
            return False
        return shutil.disk_usage(self.folder).free == 0

    def free(self) -> None:
        """Delete what `fill` wrote."""
        (self.folder / "fill").unlink(missing_ok=True)

    def hang(self) -> bool:
        """Let every write wait until `go_on`. Return whether the system does so."""
        self.hung = _works(["fsfreeze", "--freeze", str(self.folder)])
        return self.hung

    def go_on(self) -> None:
        """Carry out the writes that wait."""
        if self.hung:
            self.hung = not _works(["fsfreeze", "--unfreeze", str(self.folder)])

    def close(self, copy: Path) -> None:
        """Copy the files of the disk to a folder, and unmount the disk."""
        self.go_on()
        self.free()
        with contextlib.suppress(OSError, shutil.Error):
            shutil.copytree(self.folder, copy, dirs_exist_ok=True)
        _works(["umount", "--lazy", str(self.folder)])
        self.folder.with_name(self.folder.name + ".ext4").unlink(missing_ok=True)


def _works(command: Sequence[str]) -> bool:
    try:
        return not subprocess.run(command, capture_output=True, check=False).returncode
    except OSError:
        return False
