"""Files that describe the built-in autopilot to ground stations, in the formats of the component metadata protocol.

`component_general.json` names the other file. `parameters.json` contains type, default and range of each parameter.
A client reads them over MAVLink FTP.
"""

from __future__ import annotations

import json
import math
from typing import Any

from arena.builtin_parameters import SPECS, WITHOUT_EFFECT, Spec
from arena.wire.px4_messages import px4_crc32

_FOLDER = "/etc/extras"
_PARAMETERS = 1  # COMP_METADATA_TYPE_PARAMETER


def _parameter(name: str, spec: Spec) -> dict[str, Any]:
    whole = spec.type == "int32"
    row: dict[str, Any] = {
        "name": name,
        "type": "Int32" if whole else "Float",
        "default": int(spec.default) if whole else spec.default,
    }
    for key, value in (("min", spec.low), ("max", spec.high)):
        if math.isfinite(value):
            row[key] = int(value) if whole else value
    if name in WITHOUT_EFFECT:
        row["shortDesc"] = f"No effect in the built-in autopilot: {WITHOUT_EFFECT[name]}"
    return row


def _encoded(content: dict[str, Any]) -> bytes:
    return json.dumps({"version": 1} | content, separators=(",", ":")).encode()


def _uri(path: str) -> str:
    return f"mftp://{path.removeprefix('/')}"


_parameters_path, _general_path = f"{_FOLDER}/parameters.json", f"{_FOLDER}/component_general.json"
_parameters = _encoded({"parameters": [_parameter(name, SPECS[name]) for name in sorted(SPECS)]})
_general = _encoded(
    {
        "metadataTypes": [
            {"type": _PARAMETERS, "uri": _uri(_parameters_path), "fileCrc": px4_crc32(_parameters)}
        ]
    }
)
FILES = {_general_path: _general, _parameters_path: _parameters}
"""Path -> content."""
GENERAL = (_uri(_general_path), px4_crc32(_general))
"""URI and checksum of the file that names the others."""
