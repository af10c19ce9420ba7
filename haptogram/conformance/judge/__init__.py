"""Judgements that cases share: drives and foci against the intended ones, recovery after a case."""
