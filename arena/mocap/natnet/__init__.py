"""NatNet, the protocol of OptiTrack's Motive: codec, client, settings, and the server of the emulator."""
