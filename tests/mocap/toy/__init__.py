"""A toy vendor of motion capture: each frame is one JSON object in a UDP datagram. It shows all that a vendor has to bring."""
