"""Records that both sides share: frames that were intended, and latches that were observed.

They hold data and bring neither numpy nor I/O along.  Where observations come from lies in
:mod:`haptogram.evidence`; how a drive is computed, in :mod:`haptogram.acoustics`.
"""
