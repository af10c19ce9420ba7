"""The back door: records of what the board really did, and the focus that it made."""
