"""The virtual board: an emulated ultrasonic phased array at the far end of a serial line."""
