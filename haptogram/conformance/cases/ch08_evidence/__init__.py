"""Chapter 8, evidence: trace and read-back."""
