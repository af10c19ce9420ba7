"""Chapter 9, status and counters."""
