"""The elements at captured pins: what is wrong with each, by how much, and its structure."""
