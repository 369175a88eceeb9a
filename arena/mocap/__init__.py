"""Motion capture: the emulator of a vendor's server and the clients that receive its poses."""
