"""Motion capture: the table of vendors, a package for each vendor, what all clients share, and the emulator."""
