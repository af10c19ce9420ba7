"""The drives that pins hold, one after the other, without knowledge of a run."""
