"""Exports of the wire: ``tables`` for SPEC.md, ``c`` for firmware, ``vectors`` for tests."""
