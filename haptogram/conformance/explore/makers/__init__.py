"""Makers of what a random host sends: configurations, stream frames, requests, sessions."""
