"""Chapter 1, terms and conformance."""
