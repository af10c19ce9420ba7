"""Chapter 2, framing: delimiters, byte stuffing, checksum, lengths, the line."""
