"""Files that describe the built-in autopilot to ground stations, in the formats of the component metadata protocol.

`component_general.json` names the other files. `parameters.json` contains type, default and range of each parameter,
`all_events.json` the texts and arguments of the events. A client reads them over MAVLink FTP.
"""

from __future__ import annotations

import json
import math
from typing import Any

from arena.autopilot.events import ENUMS, TYPES, EventType, event_number
from arena.builtin_parameters import SPECS, WITHOUT_EFFECT, Spec
from arena.wire.px4_messages import px4_crc32

_FOLDER = "/etc/extras"
_PARAMETERS, _EVENTS = 1, 4  # COMP_METADATA_TYPE
_EVENTS_FORMAT = 2
_AUTOPILOT = "1"  # component id
_NAMESPACE = "px4"


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


def _event(kind: EventType) -> dict[str, Any]:
    given = [
        {"name": f"arg{k}", "type": f"{_NAMESPACE}::{name}" if name in ENUMS else name}
        for k, name in enumerate(kind.arguments)
    ]
    return {"name": kind.name, "message": kind.message} | ({"arguments": given} if given else {})


def _events_of_component() -> dict[str, Any]:
    enums = {
        name: {
            "type": "uint8_t",
            "entries": {str(v): {"name": word, "description": text} for v, (word, text) in values.items()},
        }
        for name, values in ENUMS.items()
    }
    events = {str(event_number(name)): _event(kind) for name, kind in TYPES.items()}
    return {
        "namespace": _NAMESPACE,
        "enums": enums,
        "event_groups": {"default": {"events": events}},
    }


def _encoded(content: dict[str, Any], version: int = 1) -> bytes:
    return json.dumps({"version": version} | content, separators=(",", ":")).encode()


def _uri(path: str) -> str:
    return f"mftp://{path.removeprefix('/')}"


_parameters_path, _events_path = f"{_FOLDER}/parameters.json", f"{_FOLDER}/all_events.json"
_general_path = f"{_FOLDER}/component_general.json"
_parameters = _encoded({"parameters": [_parameter(name, SPECS[name]) for name in sorted(SPECS)]})
_events = _encoded({"components": {_AUTOPILOT: _events_of_component()}}, _EVENTS_FORMAT)
_general = _encoded(
    {
        "metadataTypes": [
            {"type": kind, "uri": _uri(path), "fileCrc": px4_crc32(content)}
            for kind, path, content in (
                (_PARAMETERS, _parameters_path, _parameters),
                (_EVENTS, _events_path, _events),
            )
        ]
    }
)
FILES = {_general_path: _general, _parameters_path: _parameters, _events_path: _events}
"""Path -> content."""
GENERAL = (_uri(_general_path), px4_crc32(_general))
"""URI and checksum of the file that names the others."""
