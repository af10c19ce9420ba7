"""Chapter 6, output state, safety and time."""
