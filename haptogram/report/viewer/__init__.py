"""The interactive view of a page: array, phases, field and focus, frame by frame.

Here are the scenes that the page draws. How the page draws them is in ``templates/viewer``.
"""
