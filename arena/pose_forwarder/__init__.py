"""The pose forwarder: motion capture to the autopilot's external vision, one process per vehicle."""
