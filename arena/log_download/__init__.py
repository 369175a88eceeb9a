"""Download of log files from vehicles over MAVLink (`arena log fetch`)."""
