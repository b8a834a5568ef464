"""From goals to reference windows; pure."""
