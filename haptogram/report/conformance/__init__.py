"""The result of a run as text, JSON, JUnit XML and HTML, and several runs as a matrix."""
