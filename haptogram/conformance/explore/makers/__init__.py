"""Makers of what a random host sends: frames, drives, uploads, requests, configurations."""
