"""Chapter 3, header and checks: values, types, flags, numbers that wrap, counting."""
