"""Phase codes, packed and unpacked.  SPEC.md HG-5.2."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from haptogram_protocol.messages import PhaseFormat, packed_size


def packing_vectors() -> list[dict[str, Any]]:
    """Return every vector of ``packing.json``."""
    return [*_right_packing_vectors(), *_wrong_packing_vectors()]


def _packed_vector_codes(codes: list[int], bits: int) -> bytes:
    """Put code n into the bits n b to n b + b - 1: bit by bit, as the clause says it."""
    packed = bytearray(packed_size(len(codes), bits))
    for n, code in enumerate(codes):
        for bit in range(bits):
            place = n * bits + bit
            packed[place // 8] |= (code >> bit & 1) << place % 8
    return bytes(packed)


def _packing_vector(
    name: str, bits: int, count: int, packed: bytes, comment: str
) -> dict[str, Any]:
    return {
        "id": f"packing/{name}",
        "clauses": ["HG-5.2/1"],
        "flags": ["packing"],
        "comment": comment,
        "bits": bits,
        "count": count,
        "packed": packed.hex(),
    }


def _right_packing_vectors() -> Iterator[dict[str, Any]]:
    for bits in PhaseFormat:
        top = (1 << bits) - 1
        for count in (1, 2, 3, 4, 5, 7, 8, 9, 16, 63, 256):
            codes = [n * 29 + 1 & top for n in range(count)]
            packed = _packed_vector_codes(codes, bits)
            text = f"{count} codes of {bits} bits"
            yield _packing_vector(f"{bits}-{count}", bits, count, packed, text) | {
                "codes": bytes(codes).hex()
            }
        for place in range(8):
            codes = [top if n == place else 0 for n in range(8)]
            text = f"all bits of code {place}, none of the others"
            yield _packing_vector(
                f"{bits}-only-{place}", bits, 8, _packed_vector_codes(codes, bits), text
            ) | {
                "codes": bytes(codes).hex(),
                "flags": ["packing", "bit-order"],
            }


def _wrong_packing_vectors() -> Iterator[dict[str, Any]]:
    for bits in (PhaseFormat.BITS_6, PhaseFormat.BITS_5):
        for count in (1, 3, 5):
            if not count * bits % 8:
                continue
            packed = bytearray(packed_size(count, bits))
            for spare in range(count * bits % 8, 8):
                packed[-1] = 1 << spare
                text = f"{count} codes of {bits} bits, spare bit {spare} of the last byte set"
                yield _packing_vector(
                    f"{bits}-{count}-spare-{spare}", bits, count, bytes(packed), text
                ) | {
                    "clauses": ["HG-5.2/2"],
                    "flags": ["spare-bits"],
                    "reject": "bad_value",
                }
    for bits in PhaseFormat:
        for length in (packed_size(9, bits) - 1, packed_size(9, bits) + 1, 0):
            text = f"9 codes of {bits} bits in {length} bytes"
            yield _packing_vector(f"{bits}-in-{length}", bits, 9, bytes(length), text) | {
                "clauses": ["HG-5.2/3"],
                "flags": ["length-trusted"],
                "reject": "bad_length",
            }
