"""The motion-capture emulator: what the cameras would have sent, on the vendor's wire."""
