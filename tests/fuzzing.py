"""Hostile MAVLink: every message of the dialect with correct checksums and random contents.

A `Fuzz` draws from a `random.Random`, seeded or hypothesis', so that a campaign can be repeated and a failure shrunk. Contents are
absurd, plausible, or plausible with one absurd field. Frames are MAVLink 1 or 2, with and without their trailing zeros, too short,
too long, or signed.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from random import Random
from typing import Any

from fastcrc import crc16
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.mavlink.command_handlers import COMMANDS
from arena.builtin_parameters import SPECS

HUGE = 3.4028234663852886e38  # the largest float32
FLOATS = (
    math.nan,
    math.inf,
    -math.inf,
    HUGE,
    -HUGE,
    1e30,
    -1e30,
    1e10,
    -1e5,
    1e-45,
    -1e-40,
    0.0,
    -0.0,
    0.5,
    1.0,
    -1.0,
    2.0,
    180.1,
    400.0,
    21196.0,
    65535.4,
    2.0**31,
)
WIDTHS = {
    "B": (0, 255),
    "b": (-128, 127),
    "H": (0, 2**16 - 1),
    "h": (-(2**15), 2**15 - 1),
    "I": (0, 2**32 - 1),
    "i": (-(2**31), 2**31 - 1),
    "Q": (0, 2**64 - 1),
    "q": (-(2**63), 2**63 - 1),
}
KINDS: dict[str, Any] = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}
ALL_COMMANDS = sorted(k for k in mavlink.enums["MAV_CMD"] if k < 65536)
ITEMS = (
    16,
    17,
    18,
    19,
    20,
    21,
    22,
    31,
    84,
    93,
    112,
    177,
    178,
    179,
    189,
    195,
    201,
    206,
    5000,
    5001,
    5002,
    5003,
    5004,
    5100,
)
FRAMES = (0, 1, 2, 3, 5, 6, 8, 10, 11, 20, 255)
OFTEN = (
    "COMMAND_LONG",
    "COMMAND_INT",
    "PARAM_SET",
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_POSITION_TARGET_GLOBAL_INT",
    "SET_ATTITUDE_TARGET",
    "ODOMETRY",
    "VISION_POSITION_ESTIMATE",
    "SET_GPS_GLOBAL_ORIGIN",
    "MISSION_ITEM_INT",
    "MISSION_COUNT",
    "SET_MODE",
    "HEARTBEAT",
    "TIMESYNC",
    "PING",
    "PARAM_REQUEST_READ",
    "PARAM_REQUEST_LIST",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST_INT",
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
    "MISSION_SET_CURRENT",
)
Values = dict[str, Any]


class Fuzz:
    """A source of hostile messages. system: the vehicle they are for; lat_lon_alt: its origin [deg] [deg] [m]."""

    def __init__(
        self, rng: Random, system: int = 1, lat_lon_alt: tuple[float, float, float] = (38.7, -9.1, 100.0)
    ) -> None:
        self.rng, self.system, self.origin = rng, system, lat_lon_alt
        self.place: Sequence[float] = (0.0, 0.0, -1.0)

    # -- frames --------------------------------------------------------------------------------------------------------

    def some(self) -> list[tuple[str, bytes]]:
        """Yield (name, frame) of one message, or of a whole upload."""
        if self.rng.random() < 0.04:
            return list(self.upload())
        often = self.rng.random() < 0.7
        name = self.rng.choice(OFTEN) if often else self.rng.choice(list(KINDS))
        return [(name, self.frame(name))]

    def frame(self, name: str, **fixed: Any) -> bytes:
        """Return a frame of a message. fixed: fields that are not drawn."""
        kind = KINDS[name]
        return self.wrap(kind, self.payload(kind, {**self.values(kind), **fixed}), self.speaker())

    def command(self, number: int, *p: float) -> bytes:
        """Return a valid COMMAND_LONG to the vehicle."""
        params = (*p, *(0.0,) * (7 - len(p)))
        aim = {"target_system": self.system, "target_component": 1, "confirmation": 0, "command": number}
        kind = KINDS["COMMAND_LONG"]
        return v2(
            kind, self.payload(kind, aim | {f"param{k + 1}": x for k, x in enumerate(params)}), (255, 190)
        )

    def wrap(self, kind: Any, payload: bytes, speaker: tuple[int, int]) -> bytes:
        """Pack a payload in one of the shapes that a frame may have."""
        r, rng = self.rng.random(), self.rng
        if r < 0.1 and kind.id < 256:
            return v1(kind, payload, speaker)
        if r < 0.2:
            return v2(kind, payload[: rng.randint(1, len(payload))], speaker)  # ends early: the rest is zeros
        if r < 0.25:
            return v2(
                kind, payload.ljust(255, rng.choice((b"\0", b"\xff", b"\x7f"))), speaker
            )  # a later dialect's
        if r < 0.35:
            return v2(kind, payload, speaker, signature=rng.randbytes(13))
        return v2(kind, payload if r < 0.5 else payload.rstrip(b"\0") or b"\0", speaker)

    def speaker(self) -> tuple[int, int]:
        return self.rng.choice(
            ((255, 190), (255, 190), (self.system, 191), (self.system, 1), (253, 190), (0, 0), (77, 1))
        )

    def payload(self, kind: Any, values: Values) -> bytes:
        flat: list[Any] = []
        for name, count in zip(kind.ordered_fieldnames, kind.lengths, strict=True):
            value = values[name]
            flat += list(value) if count > 1 and not isinstance(value, bytes) else [value]
        packed: bytes = kind.unpacker.pack(*flat)
        return packed

    # -- fields --------------------------------------------------------------------------------------------------------

    def values(self, kind: Any) -> Values:
        """Draw all fields absurd, all plausible, or plausible except one."""
        absurd, r = self.absurd(kind), self.rng.random()
        if r < 0.25:
            return absurd
        said = {**self._plausible(kind.msgname), **self._aim(kind)}
        good = {name: said[name] if name in said else self._tame(value) for name, value in absurd.items()}
        if r < 0.75:
            name = self.rng.choice(list(good))
            good[name] = self._spoil(good[name], absurd[name])
        return good

    def absurd(self, kind: Any) -> Values:
        return {
            name: self._absurd(code, count, length)
            for name, code, count, length in zip(
                kind.ordered_fieldnames,
                kind.native_format[1:].decode(),
                kind.lengths,
                kind.array_lengths,
                strict=True,
            )
        } | (self._aim(kind) if self.rng.random() < 0.7 else {})

    def _absurd(self, code: str, count: int, length: int) -> Any:
        if code == "c":
            return self._text(length or 1)
        if count > 1:
            return [self._number(code) for _ in range(count)]
        return self._number(code)

    def _number(self, code: str) -> float | int:
        if code in "fd":
            return self.rng.choice(FLOATS)
        low, high = WIDTHS[code]
        return self.rng.choice((low, high, 0, 1, high - 1, high // 2, self.rng.randint(low, high)))

    def _text(self, length: int) -> bytes:
        r = self.rng.random()
        if r < 0.4:
            return self.rng.randbytes(length)
        if r < 0.6:
            return b"\xff\xfe\x80" * length
        return self.rng.choice(list(SPECS)).encode()

    def _spoil(self, value: Any, absurd: Any) -> Any:
        """Draw one number of an array, or the whole field."""
        if isinstance(value, list) and self.rng.random() < 0.7:
            k = self.rng.randrange(len(value))
            return [*value[:k], absurd[k], *value[k + 1 :]]
        return absurd

    def _tame(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self._tame(x) for x in value]
        if isinstance(value, float):
            return self.rng.uniform(-2.0, 2.0)
        return value if isinstance(value, bytes) else self.rng.randint(0, 3)

    def _aim(self, kind: Any) -> Values:
        """Draw a target: mostly the vehicle, else another one, all, or another component."""
        right, other = self.system, self.system + 1
        system, component = self.rng.choice(
            (
                (right, 1),
                (right, 1),
                (right, 1),
                (right, 0),
                (right, 190),
                (right, 51),
                (other, 1),
                (other, 0),
                (0, 0),
                (0, 1),
                (255, 255),
            )
        )
        return {
            k: v
            for k, v in (("target_system", system), ("target_component", component))
            if k in kind.fieldnames
        }

    # -- what a client might have said ---------------------------------------------------------------------------------

    def _plausible(self, name: str) -> Values:
        found = _PLAUSIBLE.get(name)
        return found(self) if found else {}

    def _near(self, most: float = 2.0) -> list[float]:
        return [x + self.rng.uniform(-most, most) for x in self.place]

    def _whole_degrees(self) -> tuple[int, int]:
        lat, lon, _ = self.origin
        return int((lat + self.rng.uniform(-1e-4, 1e-4)) * 1e7), int(
            (lon + self.rng.uniform(-1e-4, 1e-4)) * 1e7
        )

    def _command(self) -> tuple[int, list[float]]:
        rng, nan = self.rng, math.nan
        number = rng.choice(list(COMMANDS)) if rng.random() < 0.9 else rng.choice(ALL_COMMANDS)
        lat, lon = (x * 1e-7 for x in self._whole_degrees())
        given: dict[int, tuple[float, ...]] = {
            400: (rng.choice((0, 0, 1)), rng.choice((0, 0, 21196))),
            176: (rng.choice((1, 1, 209)), rng.choice((1, 4, 4, 6)), rng.choice((0, 2, 3, 4, 5, 6, 9))),
            22: (0, 0, 0, nan, nan, nan, self.origin[2] + 2.5),
            192: (-1, 1, 0, nan, lat, lon, self.origin[2] + 1.0),
            178: (1, 2.0, -1),
            179: (rng.choice((0, 1)), 0, 0, 0, lat, lon, self.origin[2]),
            511: (rng.choice((0, 1, 30, 32, 85, 331, 435)), rng.choice((-1, 0, 1, 1e4, 1e6, 1e30))),
            510: (rng.choice((30, 32, 331)),),
            512: (rng.choice((0, 30, 33, 49, 83, 85, 148, 242, 331, 435)),),
            246: (rng.choice((0, 1, 3)),),
            185: (1,),
            300: (0, 0),
            420: (rng.choice((4, 9, 100, 101)), rng.choice((0, 1)), rng.choice((0, 1, 3))),
        }
        p = [float(x) for x in given.get(number, (0.0,))]
        return number, p + [0.0] * (7 - len(p))

    def _command_long(self) -> Values:
        number, p = self._command()
        return {"command": number, **{f"param{k + 1}": x for k, x in enumerate(p)}}

    def _command_int(self) -> Values:
        number, p = self._command()
        x, y = self._whole_degrees()
        unsaid = 2**31 - 1 if self.rng.random() < 0.3 else None
        return {
            "command": number,
            "frame": self.rng.choice(FRAMES),
            "x": unsaid or x,
            "y": unsaid or y,
            "z": p[6],
            **{f"param{k + 1}": v for k, v in enumerate(p[:4])},
        }

    def _param_set(self) -> Values:
        name = self.rng.choice(list(SPECS))
        spec = SPECS[name]
        whole = spec.type == "int32"
        value = self.rng.choice((spec.default, spec.low, spec.high))
        if whole:
            value = struct.unpack("<f", struct.pack("<i", int(min(max(value, -(2**31)), 2**31 - 1))))[0]
        elif self.rng.random() < 0.3:
            value = self.rng.choice(FLOATS)
        return {"param_id": name.encode(), "param_value": value, "param_type": 6 if whole else 9}

    def _param_read(self) -> Values:
        return {
            "param_id": self.rng.choice(list(SPECS)).encode(),
            "param_index": self.rng.choice((-1, -1, 0, 5, 999)),
        }

    def _position(self) -> Values:
        rng = self.rng
        x, y, z = self._near()
        mask = rng.choice(
            (0b100111111000, 0b010111000111, 0b110000111111, 0, rng.getrandbits(16), rng.getrandbits(12))
        )
        return {"x": x, "y": y, "z": z, "coordinate_frame": rng.choice((1, 1, 8, 7)), "type_mask": mask}

    def _global(self) -> Values:
        lat, lon = self._whole_degrees()
        return self._position() | {
            "lat_int": lat,
            "lon_int": lon,
            "alt": self.origin[2] + 1.0,
            "coordinate_frame": self.rng.choice((5, 6, 11, 1)),
        }

    def _attitude(self) -> Values:
        mask = self.rng.choice((0, 0b111, 0b10000000, self.rng.getrandbits(8)))
        return {"q": self._quaternion(), "thrust": self.rng.choice((0.0, 0.5, 0.6, 1.0)), "type_mask": mask}

    def _quaternion(self) -> list[float]:
        half = self.rng.choice((0.0, 0.0, 0.05, 1.5))
        return self.rng.choice(
            (
                [math.cos(half), 0.0, 0.0, math.sin(half)],
                [math.cos(half), math.sin(half), 0.0, 0.0],
                [0.0] * 4,
            )
        )

    def _covariance(self) -> list[float]:
        scale = self.rng.choice((1e-6, 1e-4, 1.0, 1e6, HUGE, -1.0, 0.0, math.nan))
        return [scale if k in (0, 6, 11, 15, 18, 20) else 0.0 for k in range(21)]

    def _odometry(self) -> Values:
        x, y, z = self._near(self.rng.choice((0.0, 0.02, 0.3, 3.0, 500.0)))
        return {
            "x": x,
            "y": y,
            "z": z,
            "q": self._quaternion(),
            "frame_id": self.rng.choice((1, 1, 20, 8)),
            "child_frame_id": 12,
            "estimator_type": self.rng.choice((0, 2, 3, 6)),
            "pose_covariance": self._covariance(),
            "time_usec": self.rng.choice((0, 1, 10**6, 10**15, 2**64 - 1)),
        }

    def _vision(self) -> Values:
        x, y, z = self._near(self.rng.choice((0.0, 0.02, 0.3, 3.0, 500.0)))
        return {
            "x": x,
            "y": y,
            "z": z,
            "roll": 0.0,
            "pitch": 0.0,
            "yaw": self.rng.choice((0.0, 0.02, 1.0, math.pi)),
            "covariance": self._covariance(),
            "usec": self.rng.choice((0, 1, 10**6, 10**15, 2**64 - 1)),
        }

    def _origin(self) -> Values:
        rng = self.rng
        lat = rng.choice((int(self.origin[0] * 1e7), 900_000_000, -900_000_000, 899_999_999, 900_000_001, 0))
        lon = rng.choice((int(self.origin[1] * 1e7), 1_800_000_000, -1_800_000_000, 1_800_000_001))
        return {
            "latitude": lat,
            "longitude": lon,
            "altitude": rng.choice((100_000, 0, 2**31 - 1, -(2**31), 10**8)),
        }

    def _set_mode(self) -> Values:
        main, sub = self.rng.choice((1, 4, 4, 6, 7, 99)), self.rng.choice((0, 2, 3, 4, 5, 6, 106))
        return {"base_mode": self.rng.choice((0, 1, 209)), "custom_mode": main << 16 | sub << 24}

    def _count(self) -> Values:
        return {
            "count": self.rng.choice((0, 1, 2, 5, 32, 64, 65, 10_000, 65_535)),
            "mission_type": self.rng.choice((0, 1, 2, 7, 255)),
        }

    def _item(self) -> Values:
        rng = self.rng
        x, y = self._whole_degrees()
        return {
            "seq": rng.choice((0, 0, 1, 2, 9, 65_535)),
            "frame": rng.choice((3, 6, 6, 0, 5, 2, rng.choice(FRAMES))),
            "command": rng.choice(ITEMS),
            "current": rng.choice((0, 0, 1)),
            "autocontinue": rng.choice((0, 1, 1)),
            "x": x,
            "y": y,
            "z": rng.choice((1.0, 2.0, 30.0, -1.0)),
            "mission_type": rng.choice((0, 0, 1, 2, 255)),
            "param1": rng.choice((0.0, 1.0, 3.0, 4.0)),
            "param2": rng.choice((0.0, 0.3, 2.0)),
            "param4": rng.choice((0.0, math.nan)),
        }

    def _item_float(self) -> Values:
        return self._item() | {"x": self.origin[0], "y": self.origin[1], "frame": self.rng.choice((0, 2, 3))}

    def upload(self) -> Iterator[tuple[str, bytes]]:
        """Return a whole upload from one sender, with invalid items."""
        rng, kind, who = (
            self.rng,
            self.rng.choice((0, 0, 1, 2)),
            self.rng.choice(((255, 190), (self.system, 191))),
        )
        target = {
            "target_system": self.system,
            "target_component": rng.choice((0, 1, 190)),
            "mission_type": kind,
        }
        count = rng.choice((1, 2, 3, 6))
        yield self._told("MISSION_COUNT", {**self._count(), **target, "count": count, "opaque_id": 0}, who)
        command = rng.choice((5001, 5002, 5003, 5004)) if kind == 1 else 5100 if kind == 2 else None
        for seq in range(count):
            item = {**self.values(KINDS["MISSION_ITEM_INT"]), **self._item(), **target, "seq": seq}
            if command is not None:
                item |= {
                    "command": command,
                    "frame": rng.choice((0, 5, 6)),
                    "param1": float(rng.choice((count, 3, 4.0))),
                }
            for bad in rng.sample(
                ("param1", "param2", "param3", "param4", "z", "x", "frame"), rng.choice((0, 1, 1, 2))
            ):
                item[bad] = self.absurd(KINDS["MISSION_ITEM_INT"])[bad]
            yield self._told("MISSION_ITEM_INT", item, who)

    def _told(self, name: str, values: Values, who: tuple[int, int]) -> tuple[str, bytes]:
        return name, v2(KINDS[name], self.payload(KINDS[name], values), who)


_PLAUSIBLE: dict[str, Callable[[Fuzz], Values]] = {
    "COMMAND_LONG": Fuzz._command_long,
    "COMMAND_INT": Fuzz._command_int,
    "PARAM_SET": Fuzz._param_set,
    "PARAM_REQUEST_READ": Fuzz._param_read,
    "SET_POSITION_TARGET_LOCAL_NED": Fuzz._position,
    "SET_POSITION_TARGET_GLOBAL_INT": Fuzz._global,
    "SET_ATTITUDE_TARGET": Fuzz._attitude,
    "ODOMETRY": Fuzz._odometry,
    "VISION_POSITION_ESTIMATE": Fuzz._vision,
    "SET_GPS_GLOBAL_ORIGIN": Fuzz._origin,
    "SET_MODE": Fuzz._set_mode,
    "MISSION_COUNT": Fuzz._count,
    "MISSION_ITEM_INT": Fuzz._item,
    "MISSION_ITEM": Fuzz._item_float,
}


def v2(kind: Any, payload: bytes, speaker: tuple[int, int], signature: bytes = b"") -> bytes:
    head = bytes([len(payload), 1 if signature else 0, 0, 0, *speaker]) + kind.id.to_bytes(3, "little")
    return b"\xfd" + head + payload + _crc(head + payload, kind) + signature


def v1(kind: Any, payload: bytes, speaker: tuple[int, int]) -> bytes:
    head = bytes([len(payload), 0, *speaker, kind.id])
    return b"\xfe" + head + payload + _crc(head + payload, kind)


def _crc(data: bytes, kind: Any) -> bytes:
    return int(crc16.mcrf4xx(data + bytes([kind.crc_extra]))).to_bytes(2, "little")


def read(frame: bytes) -> Any:
    """Decode a frame with pymavlink; None when it cannot be decoded."""
    try:
        return mavlink.MAVLink(None).decode(bytearray(frame))
    except (mavlink.MAVError, ValueError, IndexError):
        return None
