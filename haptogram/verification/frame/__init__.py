"""The verdict on one frame: its drive and its focus against the intended ones."""
