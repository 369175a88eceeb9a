"""The YAML keys of motion capture: those that every vendor has, and those of one vendor.

A vendor's own keys are one class and one row of `VENDOR_KEYS`; `Mocap` inherits the class, so that the keys stand directly
under `mocap:`. What the keys mean to a client and a server is in the vendor's package (`arena.mocap.vendors`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from arena.mocap.vendors import DEFAULT_VENDOR, VENDORS
from arena.schema.base import Address, NotNegative, Port, Strict


class MocapNoise(Strict):
    """Noise of one camera measurement, rms per axis."""

    position_mm: NotNegative = 0.3
    """[mm]."""
    rotation_deg: NotNegative = 0.05
    """[deg]."""


class NatNetKeys(Strict):
    """Keys of NatNet, the protocol of OptiTrack."""

    version: Literal["3.1", "4.1"] = "3.1"
    """NatNet version that the emulator serves."""
    transport: Literal["multicast", "unicast"] = "multicast"
    """How NatNet frames travel."""
    group: Address | None = None
    """NatNet multicast group. Default: by rule from `address`."""
    command_port: Port = 1510
    """NatNet command port."""
    data_port: Port = 1511
    """NatNet data port."""


class Mocap(NatNetKeys):
    """The motion-capture system."""

    source: Literal["emulator", "natnet", "vrpn"] = "emulator"
    """Where poses come from: the emulator, or a server of this vendor."""
    emulates: Literal["natnet"] = DEFAULT_VENDOR
    """Vendor whose protocol the emulator serves."""
    server: Address | None = None
    """Address of the vendor's server, unless the source is the emulator. It sees hardware vehicles, the emulator simulated ones."""
    local: Address | None = None
    """Address of this computer's interface towards the server. Default: the one whose route leads there."""
    rate_hz: Annotated[float, Field(ge=10, le=1000)] = 180.0
    """Frames per second."""
    noise: MocapNoise = MocapNoise()
    """Noise that the emulator adds."""
    latency_ms: Annotated[float, Field(ge=0, le=1000)] = 10.0
    """Time from exposure to the frame on the network [ms]; at least one sensor step."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    """Seed of the camera noise."""

    @property
    def vendors(self) -> tuple[str, ...]:
        """Return the vendors in use: that of the server, where there is one, and the one that the emulator imitates."""
        served = (self.source,) if self.source in VENDORS else ()
        return tuple(dict.fromkeys((*served, self.emulates)))

    @property
    def keys(self) -> dict[str, Any]:
        """Return the values of all keys, as a vendor's `settings` reads them."""
        return self.model_dump()


# vendor -> the class of its own keys
VENDOR_KEYS: Mapping[str, type[Strict]] = {
    "natnet": NatNetKeys,
}


def keys_of_other_vendors(mocap: Mocap) -> dict[str, str]:
    """Return the YAML keys that only vendors have which are not in use -> the vendor that has each."""
    used = {
        key for vendor in mocap.vendors if vendor in VENDOR_KEYS for key in VENDOR_KEYS[vendor].model_fields
    }
    return {
        key: vendor
        for vendor, model in VENDOR_KEYS.items()
        for key in model.model_fields
        if vendor not in mocap.vendors and key not in used
    }
