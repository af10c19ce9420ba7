"""Chapter 10, errors."""
