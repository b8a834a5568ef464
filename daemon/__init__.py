"""flightd: flight-control service for PX4 drones."""
