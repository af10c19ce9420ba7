"""Clauses at every type, on every path, at every size and length of time that they speak of."""
