"""The JSON schema of arena.yaml. `program` may be a bare path there, which the model only knows as a mapping."""

from __future__ import annotations

from typing import Any

from arena.schema.models import ArenaFile


def json_schema() -> dict[str, Any]:
    """JSON schema, draft 2020-12."""
    made = ArenaFile.model_json_schema()
    for name in ("VehicleKeys", "VehicleDefaults"):
        made["$defs"][name]["properties"]["program"]["anyOf"].insert(0, {"type": "string"})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made, "title": "arena.yaml"}
