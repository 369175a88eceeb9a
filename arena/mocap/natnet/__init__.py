"""NatNet, the protocol of OptiTrack's Motive: codec, client, settings and emulated server."""
