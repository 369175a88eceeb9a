"""Motion capture: the table of vendors, one package per vendor, the code shared by all clients, and the emulator."""
