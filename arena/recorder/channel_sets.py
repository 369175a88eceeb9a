"""List of the channels that the recorder writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arena.recorder.channels import RawChannels, RecordChannels, Recorded
from arena.recorder.path_files import PathFiles

if TYPE_CHECKING:
    from foxglove import Context


def make_channels(
    settings: Mapping[str, Any], vehicles: Sequence[Recorded], context: Context
) -> list[RecordChannels]:
    """Return all sets of channels that the recorder writes.

    settings: JSON configuration (slice) of the recorder.  context: the channels must be created in this context, so that they
    are written to flight.mcap.
    """
    from arena.recorder.viewer_setup import viewer_channels

    found: list[RecordChannels] = [RawChannels(vehicles, context), viewer_channels(settings, context)]
    if settings.get("paths"):
        found.append(PathFiles(vehicles, Path(settings["paths"])))
    return found
