"""Cases of the parameter protocol: list, read, write, and parameters that do not exist."""

from __future__ import annotations

import math
import struct
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.builtin_parameters import SPECS
from px4_contract.registry import case
from px4_contract.rig import Rig
from px4_contract.transcript import Transcript

INT, FLOAT = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32


def packed(value: int) -> float:
    """Return an integer as PX4 sends it: as the float with the same bytes."""
    return float(struct.unpack("<f", struct.pack("<i", value))[0])


def value_of(m: Any) -> float:
    return (
        float(struct.unpack("<i", struct.pack("<f", m.param_value))[0])
        if m.param_type == INT
        else float(m.param_value)
    )


def read(r: Rig, name: str, index: int = -1, to: tuple[int, int] | None = None) -> Any:
    r.clear()
    r.send(mavlink.MAVLink_param_request_read_message(*(to or (r.id, 1)), name.encode(), index))
    answers = lambda r: [m for m in r.all("PARAM_VALUE") if m.param_index == index or m.param_id == name]  # noqa: E731
    r.until(answers, 0.6)
    return next(iter(answers(r)), None)


def write(r: Rig, name: str, value: float, kind: int, to: tuple[int, int] | None = None) -> str:
    """Send PARAM_SET and return a description of the reply."""
    r.clear()
    r.send(mavlink.MAVLink_param_set_message(*(to or (r.id, 1)), name.encode(), value, kind))
    r.run(0.6)
    # PX4 also announces what was changed a moment ago: the answer is the last one of this name.
    found = [m for m in r.all("PARAM_VALUE") if m.param_id == name]
    return f"{value_of(found[-1]):.6g}" if found else "silence"


@case("parameter list", "PARAM_REQUEST_LIST; type and value of every parameter that the built-in has")
def listing(r: Rig, t: Transcript) -> None:
    r.clear()
    r.send(mavlink.MAVLink_param_request_list_message(r.id, 1))
    r.until(lambda r: r.all("PARAM_VALUE"), 2.0)
    found: dict[str, Any] = {}
    before = -1
    while before != len(found):
        before = len(found)
        r.run(2.0)
        found = {m.param_id: m for m in r.all("PARAM_VALUE")}
    if not found:
        t.note("answered", False)
        return
    counts = {m.param_count for m in found.values() if m.param_index != 65535}
    indices = [m.param_index for m in found.values() if m.param_index != 65535]
    t.note("one count", len(counts) == 1)
    t.note("as many as the count", len(indices) == max(counts))
    t.note("each index once", sorted(indices) == list(range(len(indices))))
    t.note(
        "sorted by name",
        sorted(indices) == [m.param_index for n, m in sorted(found.items()) if m.param_index != 65535],
    )
    t.note("_HASH_CHECK is among them", "_HASH_CHECK" in found)
    t.note("count", max(counts))
    for name in sorted(SPECS):
        m = found.get(name)
        t.note(f"{name} type", m.param_type if m else None)
        value = value_of(m) if m else None
        if name == "MAV_SYS_ID":  # every run of the script has its own
            t.note(f"{name} is the vehicle's id", value == r.id)
        else:
            t.number(f"{name} value", value, part=1e-5)
    for name in ("NO_SUCH_NAME", "", "com_obl_rc_act"):
        t.note(f"list has {name!r}", name in found)


@case("parameter read", "PARAM_REQUEST_READ by name, by index, of missing parameters, for other vehicles")
def reading(r: Rig, t: Transcript) -> None:
    for name in ("MPC_XY_P", "COM_OBL_RC_ACT"):
        m = read(r, name)
        t.note(f"{name} by name", f"{value_of(m):.6g} type {m.param_type}" if m else "silence")
        again = read(r, "", m.param_index) if m else None
        t.note(f"{name} by its index", again.param_id if again else "silence")
    for key, name, index in (
        ("unknown name", "NO_SUCH_NAME", -1),
        ("no name", "", -1),
        ("sixteen letters", "ABCDEFGHIJKLMNOP", -1),
        ("lower case", "mpc_xy_p", -1),
        ("index beyond", "", 5000),
        ("index minus two", "MPC_XY_P", -2),
        ("hash", "_HASH_CHECK", -1),
    ):
        m = read(r, name, index)
        t.note(key, m.param_id if m else "silence")
    for key, to in (
        ("another system", (7, 1)),
        ("another component", (r.id, 51)),
        ("any component", (r.id, 0)),
        ("everybody", (0, 0)),
    ):
        m = read(r, "MPC_XY_P", to=to)
        t.note(key, m.param_id if m else "silence")


@case(
    "parameter write",
    "PARAM_SET of each type, with wrong types, values out of range or not finite, unknown names, for other vehicles",
)
def writing(r: Rig, t: Transcript) -> None:
    before = {
        name: read(r, name) for name in ("MPC_XY_P", "COM_OBL_RC_ACT", "MPC_LAND_SPEED", "COM_DISARM_LAND")
    }
    for key, name, value, kind in (
        ("float", "MPC_XY_P", 1.1, FLOAT),
        ("integer", "COM_OBL_RC_ACT", packed(5), INT),
        ("float out of its documented range, above", "MPC_XY_P", 7.0, FLOAT),
        ("float below", "MPC_XY_P", -1.0, FLOAT),
        ("integer out of range", "COM_OBL_RC_ACT", packed(99), INT),
        ("negative integer", "COM_OBL_RC_ACT", packed(-3), INT),
        ("nan", "MPC_XY_P", math.nan, FLOAT),
        ("infinite", "MPC_XY_P", math.inf, FLOAT),
        ("huge", "MPC_XY_P", 1e30, FLOAT),
        ("float back", "MPC_XY_P", 0.95, FLOAT),
        ("integer back", "COM_OBL_RC_ACT", packed(4), INT),
        ("integer as a float", "COM_OBL_RC_ACT", 5.0, FLOAT),
        ("float as an integer", "MPC_XY_P", packed(1), INT),
        ("integer as a byte", "COM_OBL_RC_ACT", packed(5), mavlink.MAV_PARAM_TYPE_UINT8),
        ("no type", "MPC_XY_P", 1.0, 0),
        ("unknown name", "NO_SUCH_NAME", 1.0, FLOAT),
        ("hash", "_HASH_CHECK", 0.0, INT),
    ):
        t.note(f"{key}: answer", write(r, name, value, kind))
        t.words(f"{key}: texts", "; ".join(f"{s} {x}" for s, x in r.texts()))
        t.note(f"{key}: a text", bool(r.texts()))
        m = read(r, name)
        after = "a hash" if name == "_HASH_CHECK" else f"{value_of(m):.6g}" if m else ""
        t.note(f"{key}: read after", after if m else "silence")
    for key, to in (
        ("another system", (7, 1)),
        ("another component", (r.id, 51)),
        ("any component", (r.id, 0)),
        ("everybody", (0, 0)),
    ):
        t.note(f"{key}: answer", write(r, "MPC_LAND_SPEED", 0.8, FLOAT, to=to))
        t.note(f"{key}: read after", f"{value_of(read(r, 'MPC_LAND_SPEED')):.6g}")
        write(r, "MPC_LAND_SPEED", 0.7, FLOAT)
    for name, m in before.items():
        if m:
            write(r, name, m.param_value, m.param_type)
