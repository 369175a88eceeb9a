"""What the reader of a frame needs to know of each MAVLink message: its CRC seed and where its target stands.

CRC_EXTRA: message id -> the seed byte that ends the frame's CRC.
TARGETS: message id -> (payload offset of target_system, of target_component or -1), in wire order.

Facts of the `common` dialect, printed from pymavlink by `python -m arena.wire.mavtargets`; a test compares.
"""

from __future__ import annotations

import re
import struct
from types import ModuleType

CRC_EXTRA: dict[int, int] = {
    0: 50, 1: 124, 2: 137, 4: 237, 5: 217, 6: 104, 7: 119, 11: 89, 20: 214, 21: 159, 22: 220, 23: 168, 24: 24,
    25: 23, 26: 170, 27: 144, 28: 67, 29: 115, 30: 39, 31: 246, 32: 185, 33: 104, 34: 237, 35: 244, 36: 222,
    37: 212, 38: 9, 39: 254, 40: 230, 41: 28, 42: 28, 43: 132, 44: 221, 45: 232, 46: 11, 47: 153, 48: 41,
    49: 39, 50: 78, 51: 196, 54: 15, 55: 3, 61: 167, 62: 183, 63: 119, 64: 191, 65: 118, 66: 148, 67: 21,
    69: 243, 70: 124, 73: 38, 74: 20, 75: 158, 76: 152, 77: 143, 81: 106, 82: 49, 83: 22, 84: 143, 85: 140,
    86: 5, 87: 150, 89: 231, 90: 183, 91: 63, 92: 54, 93: 47, 100: 175, 101: 102, 102: 158, 103: 208, 104: 56,
    105: 93, 106: 138, 107: 108, 108: 32, 109: 185, 110: 84, 111: 34, 112: 174, 113: 124, 114: 237, 115: 4,
    116: 76, 117: 128, 118: 56, 119: 116, 120: 134, 121: 237, 122: 203, 123: 250, 124: 87, 125: 203, 126: 220,
    127: 25, 128: 226, 129: 46, 130: 29, 131: 223, 132: 85, 133: 6, 134: 229, 135: 203, 136: 1, 137: 195,
    138: 109, 139: 168, 140: 181, 141: 47, 142: 72, 143: 131, 144: 127, 146: 103, 147: 154, 148: 178,
    149: 200, 162: 189, 192: 36, 225: 208, 230: 163, 231: 105, 232: 151, 233: 35, 234: 150, 235: 179, 241: 90,
    242: 104, 243: 85, 244: 95, 245: 130, 246: 184, 247: 81, 248: 8, 249: 204, 250: 49, 251: 170, 252: 44,
    253: 83, 254: 46, 256: 71, 257: 131, 258: 187, 259: 92, 260: 146, 261: 179, 262: 12, 263: 133, 264: 49,
    265: 26, 266: 193, 267: 35, 268: 14, 269: 109, 270: 59, 271: 22, 275: 126, 276: 18, 277: 62, 280: 70,
    281: 48, 282: 123, 283: 74, 284: 99, 285: 137, 286: 210, 287: 1, 288: 20, 295: 234, 296: 158, 299: 19,
    301: 243, 310: 28, 311: 95, 320: 243, 321: 88, 322: 243, 323: 78, 324: 132, 330: 23, 331: 91, 332: 236,
    333: 231, 335: 225, 339: 199, 340: 99, 345: 209, 350: 232, 360: 11, 370: 75, 373: 117, 375: 251, 376: 199,
    385: 147, 386: 132, 387: 4, 388: 8, 390: 156, 9000: 113, 9005: 117, 12900: 114, 12901: 254, 12902: 140,
    12903: 249, 12904: 77, 12905: 49, 12915: 94, 12918: 139, 12919: 7, 12920: 20,
}

TARGETS: dict[int, tuple[int, int]] = {
    4: (12, 13), 5: (0, -1), 11: (4, -1), 20: (2, 3), 21: (0, 1), 23: (4, 5), 37: (4, 5), 38: (4, 5),
    39: (32, 33), 40: (2, 3), 41: (2, 3), 43: (0, 1), 44: (2, 3), 45: (0, 1), 47: (0, 1), 48: (12, -1),
    50: (18, 19), 51: (2, 3), 54: (24, 25), 66: (2, 3), 69: (10, -1), 70: (16, 17), 73: (32, 33),
    75: (30, 31), 76: (30, 31), 77: (8, 9), 82: (36, 37), 84: (50, 51), 86: (50, 51), 110: (1, 2),
    117: (4, 5), 119: (10, 11), 121: (0, 1), 122: (0, 1), 123: (0, 1), 139: (41, 42), 243: (52, -1),
    248: (3, 4), 256: (8, 9), 258: (0, 1), 266: (2, 3), 267: (2, 3), 268: (2, 3), 282: (32, 33),
    284: (30, 31), 285: (38, 39), 286: (50, 51), 287: (20, 21), 288: (20, 21), 296: (36, 37), 320: (2, 3),
    321: (0, 1), 323: (0, 1), 345: (2, 3), 385: (2, 3), 386: (4, 5), 387: (4, 5), 388: (32, 33),
    12900: (0, 1), 12901: (30, 31), 12902: (4, 5), 12903: (0, 1), 12904: (28, 29), 12905: (0, 1),
    12915: (0, 1), 12919: (16, 17),
}

_MANUAL_CONTROL = 69  # its `target` is a system too, under a name of its own


def tables_of(dialect: ModuleType) -> tuple[dict[int, int], dict[int, tuple[int, int]]]:
    """(CRC_EXTRA, TARGETS) of a pymavlink dialect."""
    crc_extra: dict[int, int] = {}
    targets: dict[int, tuple[int, int]] = {}
    for number, message in sorted(dialect.mavlink_map.items()):
        crc_extra[number] = message.crc_extra
        tokens = re.findall(r"\d*[a-zA-Z]", message.unpacker.format)
        offsets, at = {}, 0
        for field, token in zip(message.ordered_fieldnames, tokens, strict=True):
            offsets[field] = at
            at += struct.calcsize("<" + token)
        system = "target" if number == _MANUAL_CONTROL else "target_system"
        if system in offsets:
            targets[number] = offsets[system], offsets.get("target_component", -1)
    return crc_extra, targets


def _wrapped(name: str, kind: str, entries: list[str]) -> str:
    lines, line = [], "   "
    for entry in entries:
        if len(line) + len(entry) > 108:
            lines.append(line)
            line = "   "
        line += f" {entry},"
    return "\n".join([f"{name}: {kind} = {{", *lines, line, "}"])


def source() -> str:
    """The two tables as they stand above."""
    from pymavlink.dialects.v20 import common

    crc_extra, targets = tables_of(common)
    return "\n\n".join([
        _wrapped("CRC_EXTRA", "dict[int, int]", [f"{k}: {v}" for k, v in crc_extra.items()]),
        _wrapped("TARGETS", "dict[int, tuple[int, int]]", [f"{k}: {v}" for k, v in targets.items()]),
    ])


if __name__ == "__main__":
    print(source())
