"""The conformance suite: it judges a board by every clause of SPEC.md.  Reports lie elsewhere.

Every clause has at least one case.  A case exchanges raw frames with the board through a
:class:`~haptogram.driver.line.port.Transport` and waits by that transport's clock only, so that
the same case runs in virtual time on the virtual board and in wall time on a pty or a port.

Importing this package loads nothing: the pytest plugin stands in its place in the environment of
people who only have a test to run.
"""
