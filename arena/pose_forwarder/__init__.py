"""The pose forwarder: sends motion-capture poses to the autopilot as external vision, one process per vehicle."""
