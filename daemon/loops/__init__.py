"""Control, trajectory and health tasks and the grid they run on."""
