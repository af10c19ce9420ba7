"""Exports of the protocol: tables of SPEC.md, C headers, test vectors."""
