"""The client of the board under test: raw frames, requests, malformed frames, their answers."""
