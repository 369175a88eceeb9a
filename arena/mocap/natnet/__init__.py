"""NatNet, the protocol of OptiTrack's Motive: codec, client and emulated server."""
