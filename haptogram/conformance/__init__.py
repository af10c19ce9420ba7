"""Conformance: whether a board does what SPEC.md demands, clause by clause.

Every clause has a case or more.  A case talks to the board in raw frames through a
:class:`~haptogram.driver.line.port.Transport` and waits by that transport's clock only, so the same
case runs in virtual time on the virtual board and in wall time on a pty or a port.

Importing this package loads nothing: the pytest plugin stands in its place in the environment of
people who only have a test to run.
"""
