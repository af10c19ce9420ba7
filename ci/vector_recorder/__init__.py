"""Recorder of the dialogues in protocol/vectors: conformance cases, two boards, virtual time.

Frames are not recorded: they are typed in ``wire_export.vectors``.
"""
