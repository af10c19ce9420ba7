"""Description of the protocol and the generated parts of SPEC.md; no C and no vectors.

``python -m haptogram_protocol.export.tables --spec protocol/SPEC.md`` rewrites the parts of SPEC.md
that stand between a ``generated`` marker and an ``end`` marker; ``--json`` prints the description
for generators of other languages.
"""

from .schema import CONSTANTS, ENUMERATIONS, RECORDS, wire_description

__all__ = ["CONSTANTS", "ENUMERATIONS", "RECORDS", "wire_description"]
