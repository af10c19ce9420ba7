"""Chapter 12, timers."""
