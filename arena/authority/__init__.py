"""Control authority: decides who may command one vehicle.

`requests` reads the requests in MAVLink frames, `authority` decides whether they are allowed, and `command_gate` refuses
frames and encodes the replies. Pure.

Imports only the standard library and `wire`, because land-all uses it and must start fast.
"""

from arena.authority.authority import Authority
from arena.authority.command_gate import (
    TEMPORARILY_REJECTED,
    CommandGate,
    Refusal,
    pack_reply,
    role_of_tool,
    role_on_link,
)
from arena.authority.requests import (
    COMMANDS,
    MESSAGES,
    MISSION_STARTS,
    PROGRAM_MODES,
    Kind,
    Request,
    command_of,
    parse_request,
)
from arena.authority.roles import Role

__all__ = [
    "COMMANDS",
    "MESSAGES",
    "MISSION_STARTS",
    "PROGRAM_MODES",
    "TEMPORARILY_REJECTED",
    "Authority",
    "CommandGate",
    "Kind",
    "Refusal",
    "Request",
    "Role",
    "command_of",
    "pack_reply",
    "parse_request",
    "role_of_tool",
    "role_on_link",
]
