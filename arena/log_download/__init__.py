"""Download of log files from vehicles over MAVLink, for the command `arena log fetch`."""
