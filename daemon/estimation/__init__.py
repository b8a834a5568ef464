"""From telemetry to the state at the moment a command acts; pure."""
