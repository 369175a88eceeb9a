"""Transfer of parameters to and from vehicles over MAVLink.

request_window   requests in flight, repeated until answered; decides when a missing answer means "no such parameter"
transfer         one vehicle: heartbeats, time-outs, rebooting; base of reader and writer
reader, writer   read some parameters or the whole list; write what differs and read it back
push_record      push.json, from which an interrupted push is resumed
transports       one connection: UDP socket or serial device
session          many vehicles at once

All but `transports`, `session` and the file of `push_record` are pure: frames and time in, frames and state out.
"""
