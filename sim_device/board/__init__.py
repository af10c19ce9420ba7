"""The board: registers, queue, timers, output.  No bytes and no wall clock."""
