"""The JSON schema of arena.yaml, in which `program` may be a bare path too."""

from __future__ import annotations

from typing import Any

from arena.schema.models import ArenaFile


def json_schema() -> dict[str, Any]:
    """Return the JSON schema, draft 2020-12."""
    made = ArenaFile.model_json_schema()
    for name in ("VehicleKeys", "VehicleDefaults"):
        made["$defs"][name]["properties"]["program"]["anyOf"].insert(0, {"type": "string"})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made, "title": "arena.yaml"}
