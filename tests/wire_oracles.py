"""Framing done slowly, bit by bit and byte by byte, from the text of SPEC.md chapter 2 alone."""

CRC_POLYNOMIAL = 0xEDB88320


def crc32_bitwise(data: bytes) -> int:
    """CRC-32/ISO-HDLC, one bit at a time: no table, no zlib."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ (CRC_POLYNOMIAL if register & 1 else 0)
    return register ^ 0xFFFFFFFF


def cobs_encode_bytewise(data: bytes) -> bytes:
    """The textbook's encoder: one byte at a time, the code byte filled in when its piece ends."""
    out = bytearray([0])
    code_at, code = 0, 1
    for number, byte in enumerate(data):
        if byte:
            out.append(byte)
            code += 1
        if byte == 0 or code == 0xFF:
            out[code_at] = code
            if byte and number == len(data) - 1:
                return bytes(out)  # a full piece at the very end has no piece behind it
            code_at, code = len(out), 1
            out.append(0)
    out[code_at] = code
    return bytes(out)


def cobs_decode_bytewise(encoded: bytes) -> bytes | None:
    """The textbook's decoder; None where a code byte points past the end or is zero."""
    out = bytearray()
    at = 0
    while at < len(encoded):
        code = encoded[at]
        if code == 0 or at + code > len(encoded):
            return None
        out += encoded[at + 1 : at + code]
        at += code
        if code != 0xFF and at < len(encoded):
            out.append(0)
    return bytes(out)


def frame_bytewise(body: bytes) -> bytes:
    """Everything that a frame is on the line."""
    crc = crc32_bitwise(body)
    little_endian = bytes((crc >> shift) & 0xFF for shift in (0, 8, 16, 24))
    return b"\0" + cobs_encode_bytewise(body + little_endian) + b"\0"
