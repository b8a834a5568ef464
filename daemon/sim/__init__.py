"""A simulated PX4: vehicle physics, behaviour, MAVLink end, faults."""
