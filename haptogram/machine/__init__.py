"""Services of the operating system: descriptors, process priority, files, temporary folders.

Nothing here knows a board, a frame or a field.
"""
