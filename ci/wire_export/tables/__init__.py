"""Description of the protocol and the generated parts of SPEC.md; no C and no vectors.

The parts of SPEC.md stand between a ``generated`` marker and an ``end`` marker.
"""

from .schema import CONSTANTS, ENUMERATIONS, RECORDS, wire_description

__all__ = ["CONSTANTS", "ENUMERATIONS", "RECORDS", "wire_description"]
