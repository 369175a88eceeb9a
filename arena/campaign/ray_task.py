"""Flight of a campaign in a Ray worker: checks the files, flies, and returns all files of the run."""

from __future__ import annotations

import signal
import tempfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from arena.campaign.design import Flight
from arena.campaign.inputs import PACKAGE, PX4, digest_of
from arena.campaign.runner import Fly
from arena.campaign.store import Record
from arena.errors import InputError

Files = Mapping[str, bytes]


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """Result and files of a flight, sent from a Ray worker to the computer that started the campaign.

    files: path relative to the folder of the campaign -> compressed content.
    """

    record: Record
    files: Files


def fly_here(flight: Flight, inputs: Mapping[str, str], flown_by: Fly) -> Delivery:
    """Fly one flight in a temporary folder of this computer, and return its result and files.

    When this function returns, the arena of the flight has ended.

    Raises InputError if this computer has other files than the campaign. `ray.cancel` interrupts it like Ctrl-C.
    """
    # Ray blocks SIGINT in its workers. The processes of the arena would inherit that.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if problems := problems_here(inputs):
        raise InputError("\n".join(problems))
    with tempfile.TemporaryDirectory(prefix="arena-campaign-", ignore_cleanup_errors=True) as folder:
        record = flown_by(flight, Path(folder))
        return Delivery(record=record, files=pack(Path(folder)))


def problems_here(inputs: Mapping[str, str]) -> list[str]:
    """Return one text per file that is missing on this computer, or that differs from the campaign's file.

    inputs: path -> SHA-256 of each file, as `digest_of` returns it.
    """
    found = []
    for path, expected in inputs.items():
        if not (digest := digest_of(path)):
            found.append(f"{path} is missing")
        elif digest != expected:
            found.append(f"{path} differs from the file of the campaign")
    return found


def inputs_of(files: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Return absolute path -> SHA-256 of the files that must be the same on every computer of the cluster.

    They are the files of the campaign and, under the key PACKAGE, the installed package `arena`.

    files: path relative to `folder` -> SHA-256.
    """
    special = (PACKAGE, PX4)
    made = {str((folder / path).resolve()): digest for path, digest in files.items() if path not in special}
    return {**made, PACKAGE: digest_of(PACKAGE)}


def pack(folder: Path) -> Files:
    """Return relative path -> compressed content of all files in a folder and its subfolders."""
    return {
        str(path.relative_to(folder)): zlib.compress(path.read_bytes(), 1)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def unpack(files: Files, folder: Path) -> None:
    """Write the files that `pack` returned into a folder."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(zlib.decompress(content))
