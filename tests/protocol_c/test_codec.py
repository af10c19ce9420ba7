"""The C codec against the vectors, and faulty codecs that the vectors must tell apart."""

import pytest

from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import MESSAGES
from protocol_c.building import FOLDER, compiler, compilers, rebuilt, run, spoilt
from protocol_vectors.vector_files import FRAME_FILES, vectors

FRAMES = vectors(*FRAME_FILES)
HEADER = ("type", "flags", "seq", "time_us", "session")


def lines(folder, mode, inputs):
    """What the tool prints for each line of input, as lists of lines."""
    status, output = run(folder / "codec_lines", mode, input="\n".join([*inputs, ""]))
    assert status == 0, output
    return [part.splitlines() for part in output.split(".\n")[:-1]]


def decoded(folder, size):
    """The outcomes that the C decoder gives for the frames of every vector."""
    return [outcomes(found) for found in lines(folder, size, [v["line"] for v in FRAMES])]


def outcomes(found):
    """The outcomes of a vector, from what the tool printed for its bytes."""
    result = []
    for line in found:
        word, *rest = line.split(" ")
        if word == "drop":
            result.append({"drop": rest[0]})
        elif word == "frame":
            header = dict(zip(HEADER, map(int, rest), strict=True))
            result.append({"header": header, "fields": {}})
        elif word == "bad":
            result[-1] |= {"reject": rest[0], "offset": int(rest[1])}
            del result[-1]["fields"]
        else:
            result[-1]["fields"].setdefault("lines", []).append(line)
    return result


def expected(vector):
    """The same from the vector: messages as the lines that the tool must print."""
    result = []
    for outcome in vector["outcome"]:
        if "frame" not in outcome:
            result.append(outcome)
            continue
        frame = outcome["frame"]
        printed = list(field_lines(frame["message"], frame["fields"]))
        fields = {"lines": printed} if printed else {}
        result.append({"header": frame["header"], "fields": fields})
    return result


KINDS = {kind.TYPE.name: kind for kind in MESSAGES.values()}


def field_lines(message, fields):
    kind = KINDS[message]
    for name in kind.WIRE:
        yield from value_lines(name, fields[name])
    if kind.TAIL is not None:
        content = fields[kind.TAIL.name]
        if kind.TAIL.record is None:
            yield f"tail {kind.TAIL.name} {content or '-'}"
        else:
            yield f"tail {kind.TAIL.name} {len(content)}"
            for item in content:
                for name, value in item.items():
                    yield from value_lines(name, value)


def value_lines(name, value):
    if isinstance(value, dict):
        for inner, item in value.items():
            yield from value_lines(f"{name}.{inner}", item)
    elif name == "firmware":
        yield f"{name} {value.encode().ljust(16, bytes(1)).hex()}"
    else:
        yield f"{name} {value}"


@pytest.mark.parametrize("size", ["0", "1", "7"])
def test_the_c_decoder_agrees_with_every_vector(programs, size):
    for vector, found in zip(FRAMES, decoded(programs, size), strict=True):
        assert found == expected(vector), vector["id"]


def test_the_c_encoder_gives_the_same_bytes_as_python(programs):
    valid = vectors("frames-valid.json")
    bodies = [vector["outcome"][0]["frame"]["body"] for vector in valid]
    assert lines(programs, "encode", bodies) == [[vector["line"]] for vector in valid]
    lengths = (*range(10, 40), *range(240, 270), *range(500, 516), 4075)
    runs = [(bytes(1 + n % 255 for n in range(k)), bytes(k), b"\xff" * k) for k in lengths]
    made = [body for run_of in runs for body in run_of]
    found = lines(programs, "encode", [body.hex() for body in made])
    assert found == [[encode_frame(body).hex()] for body in made]


def test_python_reads_what_c_writes(programs):
    bodies = [bytes([0x44, *range(length)]) for length in range(9, 200)]
    for body, (line,) in zip(
        bodies, lines(programs, "encode", [body.hex() for body in bodies]), strict=True
    ):
        assert FrameDecoder().feed(bytes.fromhex(line)) == [body]


# Each is a mistake that firmware has made; every one must be seen in the vectors.
MISTAKES = {
    "crc-not-checked": ("if (hg_crc32(0, body, length) != hg_get_u32(body + length))", "if (0)"),
    "crc-without-final-xor": ("return ~crc & 0xFFFFFFFFu;", "return crc;"),
    "code-past-end-trusted": ("from + code > length", "from + code > length + 1"),
    "full-piece-implies-zero": ("zero_due = code != FULL_BLOCK;", "zero_due = 1;"),
    "longest-frame-one-short": (
        "parser->length < HG_MAX_ENCODED_BYTES",
        "parser->length < HG_MAX_ENCODED_BYTES - 1",
    ),
    "no-resync-after-long-run": ("parser->discarding = 0;\n        } else", ";\n        } else"),
    "length-not-checked": ("return rest == 0 ||", "return 1 ||"),
    "value-not-checked": ("payload[*offset] > 31 || ", "0 && "),
    "tail-not-in-units": ("return rest % layout->unit == 0 && ", "return "),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_faulty_codec_is_told_apart(tmp_path, plain_programs, mistake):
    source = spoilt(tmp_path, "haptogram_codec.c", *MISTAKES[mistake])
    folder = rebuilt(tmp_path, plain_programs, source, "codec_lines")
    assert decoded(folder, "0") != [expected(vector) for vector in FRAMES]


def test_the_codec_needs_nothing_of_the_c_library_but_memcpy_and_memset(tmp_path):
    compiler()
    strict = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion")
    for name in compilers():
        command = (name, *strict, "-O2", "-c", FOLDER / "haptogram_codec.c", "-o", tmp_path / "o")
        assert run(*command) == (0, "")
        status, needed = run("nm", "-u", tmp_path / "o")
        assert status == 0
        assert set(needed.split()) - {"U"} <= {"memcpy", "memset"}
