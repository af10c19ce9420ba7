"""Published systems and the published paper, next to our figures."""
