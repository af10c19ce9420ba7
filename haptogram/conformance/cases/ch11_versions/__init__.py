"""Chapter 11, versions and deprecation."""
