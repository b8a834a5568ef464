"""The link to the autopilot."""
