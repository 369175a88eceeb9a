"""List of the channels that the recorder writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arena.recorder.channels import RawChannels, RecordChannels, Recorded
from arena.recorder.mcap_file import MakeChannel
from arena.recorder.path_files import PathFiles


def make_channels(
    settings: Mapping[str, Any], vehicles: Sequence[Recorded], channel: MakeChannel
) -> list[RecordChannels]:
    """Return all sets of channels that the recorder writes.

    settings: JSON configuration (slice) of the recorder.  channel: creates a channel in the record.
    """
    from arena.recorder.viewer_setup import viewer_channels

    found: list[RecordChannels] = [RawChannels(vehicles, channel), viewer_channels(settings, channel)]
    if settings.get("paths"):
        found.append(PathFiles(vehicles, Path(settings["paths"])))
    return found
