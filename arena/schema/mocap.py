"""The YAML keys under `mocap`: keys for all vendors, and keys for a single vendor.

Each vendor with keys of its own has a class here and a row in `VENDOR_KEYS`. `Mocap` inherits the class, so that users write
these keys directly under `mocap:`. The vendor's package uses their values (`arena.mocap.vendors`).
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from arena.constants import MAX_MOCAP_LATENCY_MS
from arena.mocap.vendors import DEFAULT_VENDOR, VENDORS
from arena.schema.base import Address, NotNegative, Port, Strict


class MocapNoise(Strict):
    """Noise of one measured pose, as rms per axis."""

    position_mm: NotNegative = 0.3
    """[mm]."""
    rotation_deg: NotNegative = 0.05
    """[deg]."""


class NatNetKeys(Strict):
    """Keys of NatNet, the protocol of OptiTrack."""

    version: Literal["3.1", "4.1"] = "3.1"
    """NatNet version that the emulator serves."""
    transport: Literal["multicast", "unicast"] = "multicast"
    """Transmission of NatNet frames: multicast or unicast."""
    group: Address | None = None
    """NatNet multicast group. Default: derived from `address`."""
    command_port: Port = 1510
    """NatNet command port."""
    data_port: Port = 1511
    """NatNet data port."""


class Mocap(NatNetKeys):
    """The motion capture system: source, rate, noise and delay of the poses."""

    source: Literal["emulator", "natnet", "vrpn"] = "emulator"
    """Source of poses: the emulator, or the name of the vendor whose server is used."""
    emulates: Literal["natnet"] = DEFAULT_VENDOR
    """Vendor whose protocol the emulator serves."""
    server: Address | None = None
    """Numeric address of the vendor's server, which measures hardware vehicles. Not used if the source is the emulator."""
    local: Address | None = None
    """Address of this computer in the server's network. Default: taken from the route to the server."""
    rate_hz: Annotated[float, Field(ge=10, le=1000)] = 180.0
    """Frames per second."""
    noise: MocapNoise = MocapNoise.model_construct()
    """Noise that the emulator adds."""
    latency_ms: Annotated[float, Field(ge=0, le=MAX_MOCAP_LATENCY_MS)] = 10.0
    """Delay from the camera exposure to the frame on the network [ms]; at least one sensor step."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    """Seed of the camera noise."""

    @property
    def vendors(self) -> tuple[str, ...]:
        """Return the vendors in use: the vendor of the real server, and the vendor that the emulator imitates."""
        served = (self.source,) if self.source in VENDORS else ()
        return tuple(dict.fromkeys((*served, self.emulates)))

    @property
    def keys(self) -> dict[str, Any]:
        """Return all keys under `mocap` with their values, for the code of each motion capture vendor."""
        return self.as_dict()


# vendor -> the class of its own keys
VENDOR_KEYS: Mapping[str, type[Strict]] = {
    "natnet": NatNetKeys,
}


def keys_of_other_vendors(mocap: Mocap) -> dict[str, str]:
    """Return the keys that have no effect, because their vendor is not in use: YAML key -> vendor."""
    used = {
        key for vendor in mocap.vendors if vendor in VENDOR_KEYS for key in VENDOR_KEYS[vendor].model_fields
    }
    return {
        key: vendor
        for vendor, model in VENDOR_KEYS.items()
        for key in model.model_fields
        if vendor not in mocap.vendors and key not in used
    }
