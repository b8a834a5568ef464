"""Flight record and report."""
