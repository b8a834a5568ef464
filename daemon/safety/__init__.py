"""Whether a setpoint may leave: conditions, supervisor table, geofence, dead-man."""
