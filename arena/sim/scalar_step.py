"""Empty module, to be deleted: small fleets move like large ones, by the kernel `free_flight`."""
