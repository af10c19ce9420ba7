"""Requests at limits that random dialogues have to meet, and what they have met before."""
