"""Scenes of a random dialogue: a board is brought into a state, and then gets an input.

States and inputs are tables; each state meets each group of inputs once before any does so twice.
"""
