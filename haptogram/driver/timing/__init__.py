"""Time at the host: the device clock, deadlines, leads, and when each frame is due."""
