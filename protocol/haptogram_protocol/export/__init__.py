"""Exports of the wire to other languages: ``tables`` for SPEC.md, ``c`` for firmware, ``vectors``.

Each room is a command, ``python -m haptogram_protocol.export.ROOM``. Host and board import nothing
of it but the description hash.
"""
