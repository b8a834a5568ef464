"""Plain clients that the benchmark of the loop compares the daemon with."""
