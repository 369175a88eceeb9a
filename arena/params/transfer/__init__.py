"""Transfer of parameters to and from vehicles over MAVLink.

request_window   repeats requests until they are answered; decides when a missing answer means "no such parameter"
transfer         transfer with one vehicle: heartbeats, time-outs, reboot; base class of reader and writer
reader           reads some parameters or the whole list
after_reboot     waits until the vehicle has rebooted, then reads parameters
writer           writes the parameters that differ and reads them back
push_record      the file push.json, from which an interrupted push is resumed
transports       connection to one vehicle: UDP socket or serial device
transfer_loop    loop that runs transfers with many vehicles at the same time
session          pull, push and reboot, with many vehicles at the same time

`transports`, `transfer_loop` and `session` use sockets, devices and clocks, `push_record` uses
a file. The others are pure: they take received frames and the time, and return the frames to send.
"""
