"""Chapter 4, session and requests."""
