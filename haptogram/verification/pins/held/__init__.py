"""The drives that pins hold, one after the other, whoever meant them: without a run."""
