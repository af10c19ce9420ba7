"""Records that both sides share: which frame was meant, and which was latched.

Where observations come from lies in :mod:`haptogram.evidence`.
"""
