"""Running a simulation: its folder, the loop over outputs, checkpoints and resume."""
