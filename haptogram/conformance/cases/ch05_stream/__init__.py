"""Chapter 5, stream and latch."""
