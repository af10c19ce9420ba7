"""The client of the board under test: raw, also malformed frames, requests, the board's clock.

No judgement of a drive or a timer, and no case, lies here.
"""
