"""Motion capture: the table of vendors, one package per vendor, code shared by all clients, and the emulator."""
