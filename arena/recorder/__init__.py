"""Process that records a flight. It must never send data to a vehicle."""
