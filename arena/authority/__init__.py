"""Decision who may command one vehicle. `requests` reads commands from MAVLink frames; `authority` decides about them. Pure.

Imports only the standard library and `wire`, because land-all uses it and must start fast.
"""

from arena.authority.authority import PROGRAM_MODES, Authority, Role
from arena.authority.requests import MANUAL_MODES, Kind, Request, parse_request

__all__ = ["MANUAL_MODES", "PROGRAM_MODES", "Authority", "Kind", "Request", "Role", "parse_request"]
