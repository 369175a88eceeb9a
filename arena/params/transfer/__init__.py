"""Transfer of parameters to and from vehicles over MAVLink."""
