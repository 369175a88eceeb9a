"""How a real autopilot is reached: the `url` of a hardware vehicle and the `serial` of one in the loop, as data. Pure."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import Literal

EXPECTED = "udpin:HOST:PORT (it speaks to us), udpout:HOST:PORT (we speak to it) or serial:DEVICE, as in udpin:0.0.0.0:14540"


@dataclass(frozen=True, kw_only=True)
class Wire:
    """kind udpin, udpout: host, port.  kind serial: device, baud."""

    kind: Literal["udpin", "udpout", "serial"]
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0

    @property
    def words(self) -> str:
        """As a person reads it."""
        return (
            f"serial {self.device} at {self.baud}"
            if self.kind == "serial"
            else f"{self.kind} {self.host}:{self.port}"
        )

    @property
    def url(self) -> str:
        """As the YAML writes it; a serial device's baud rate is a key of its own."""
        return f"serial:{self.device}" if self.kind == "serial" else f"{self.kind}:{self.host}:{self.port}"


def serial_wire(device: str, baud: int) -> Wire:
    return Wire(kind="serial", device=device, baud=baud)


def read_url(url: str, baud: int) -> Wire:
    """Raises ValueError with what was expected."""
    kind, _, rest = url.partition(":")
    if kind == "serial" and rest.startswith("/"):
        return serial_wire(rest, baud)
    host, _, port = rest.rpartition(":")
    if kind not in ("udpin", "udpout") or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise ValueError(EXPECTED)
    try:
        address = ipaddress.IPv4Address(host)
    except ValueError as error:
        raise ValueError(f"{EXPECTED}; HOST is a numeric address") from error
    if kind == "udpout" and (address.is_unspecified or address.is_multicast or host == "255.255.255.255"):
        raise ValueError(f"{EXPECTED}; udpout names one vehicle's own address")
    return Wire(kind="udpin" if kind == "udpin" else "udpout", host=str(address), port=int(port))
