"""Shared memory with the newest captured pose of each rigid body (pose page). A fused arena gives it to its user programs.

The programs then need no motion-capture client each, which would receive and decode every frame. Layout, native doubles:

    per body 9 numbers: count, p_n (3) [m] [NED], q_nb (4) [-] wxyz, count

`count` is the number of poses of the body so far, 0 before the first. The writer changes the first count, then the pose, then the
last one. If a reader finds two different counts, the pose is being written.
"""

from __future__ import annotations

import mmap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from arena.errors import RunError
from arena.kernels.captured_poses import POSE_ROW, store_poses

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats
    from arena.kernels.capture_types import Pose


class PosePageWriter:
    """Writer of the pose page.

    path: file of the page; an existing file is replaced.  bodies: names of the rigid bodies, in the order of their rows
    """

    def __init__(self, path: str | Path, bodies: Sequence[str]) -> None:
        part = Path(f"{path}.new")  # a reader finds a complete page or none
        with part.open("w+b") as file:
            file.truncate(8 * POSE_ROW * max(1, len(bodies)))
            self._page = memoryview(mmap.mmap(file.fileno(), 0)).cast("d")
        part.replace(path)
        self._begins = {body: POSE_ROW * row for row, body in enumerate(bodies)}

    def write(self, poses: Sequence[Pose]) -> None:
        """Store the poses of one frame. Bodies without a row are left out; bodies without a pose keep their last one."""
        store_poses(poses, self._begins, self._page)


class PoseRow:
    """Reader of the row of one rigid body in the pose page. A pose that was written before the reader exists is never new.

    row: index of the body.  Raises RunError if there is no such page.
    """

    def __init__(self, path: str | Path, row: int) -> None:
        begin = POSE_ROW * row
        try:
            with Path(path).open("rb") as file:
                page = memoryview(mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)).cast("d")
        except (OSError, ValueError) as error:
            raise RunError(
                f"{path}: no shared memory with the captured poses (pose page): is the process `world` running?"
            ) from error
        if row < 0 or len(page) < begin + POSE_ROW:
            raise RunError(f"{path}: the pose page has no row {row}")
        self._row: Floats = page[begin : begin + POSE_ROW]
        self._count = self._row[POSE_ROW - 1]  # that pose can be old: the body may have been lost since then

    def new_pose(self) -> list[float] | None:
        """Return position [m] [NED] and attitude q_nb wxyz of the newest pose (7,); None without a new pose since the last call."""
        row = self._row
        if row[POSE_ROW - 1] == self._count:
            return None
        last = row[POSE_ROW - 1]
        found: list[float] = [*row[1 : POSE_ROW - 1]]
        if row[0] != last:
            return None  # the pose is being written: the next call finds it
        self._count = last
        return found
