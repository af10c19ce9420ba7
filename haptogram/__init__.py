"""Host of the Haptogram harness: drives an ultrasonic phased array and verifies what it radiated."""

__version__ = "0.1.0"
