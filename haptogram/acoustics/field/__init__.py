"""The pressure field of a driven array, at points, on planes, and in time."""
