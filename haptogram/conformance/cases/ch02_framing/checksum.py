"""HG-2.4: the CRC-32 of every frame."""

from __future__ import annotations

from haptogram_protocol.messages import Error, Feature, HelloReply, Ping

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...client.introduction import introduce_to_board
from ...client.wire import ReceivedByClient
from ...judge.timers import judge_lease_ends
from ...outcome import SELF_REPORTED, check, inconclusive


@case("HG-2.4/1", needs_session=False)
def frames_have_crc32_checksum(board: BoardClient) -> None:
    """HELLO with a CRC-32 is answered by a frame with a CRC-32; another checksum is named"""
    board.link.session = 0
    for _ in range(3):
        reply = introduce_to_board(board)
        if isinstance(reply, HelloReply):
            _check_checksum(board)
            return
        if reply is not None:
            inconclusive(f"HELLO is answered by {reply}, with its CRC-32")
    wrong = [piece for piece in _framed_greetings(board, 0) if piece.reason == "crc"]
    check(not wrong, f"frames come, but none with its CRC-32: {wrong[0].fault if wrong else ''}")
    for name, data in malformed_frames.malformed_checksums(_hello_with_checksum(board)).items():
        since = board.link.mark()
        board.link.send(malformed_frames.malformed_frame(data))
        board.wire.wait_for(_is_framed_greeting, since, board.wire.limits.answer_us)
        answered = _framed_greetings(board, since)
        check(not answered, f"HELLO is answered if it ends with {name} instead of CRC-32")
    inconclusive("no HELLO is answered, with whatever checksum")


def _framed_greetings(board: BoardClient, since: int) -> list[ReceivedByClient]:
    """Return the pieces that begin like an answer to HELLO, with any checksum."""
    return [piece for piece in board.wire.received[since:] if _is_framed_greeting(piece)]


def _is_framed_greeting(piece: ReceivedByClient) -> bool:
    return piece.unstuffed[:1] in (bytes([HelloReply.TYPE]), bytes([Error.TYPE]))


def _hello_with_checksum(board: BoardClient) -> bytes:
    hello = board.hello_message(board.new_nonce())
    return board.link.body(hello.TYPE, hello.serialize(), seq=board.link.next_seq(), session=0)


def _check_checksum(board: BoardClient) -> None:
    board.prepare()
    wrong = [piece for piece in full_client_dialogue(board) if piece.reason in ("crc", "short")]
    check(not wrong, f"a frame without its CRC-32: {wrong[0].fault if wrong else ''}")


@case("HG-2.4/2", evidence=SELF_REPORTED)
def drops_frames_of_wrong_checksum(board: BoardClient) -> None:
    """frames with a wrong CRC are counted in crc; they get no answer and use up no number"""
    flips = (1, 0x80000000, 0x00010000, 0xFFFFFFFF)
    body = board.link.body(Ping.TYPE, bytes(8), seq=board.link.next_seq())
    stream = board.link.body(
        board.flat_phases().TYPE, board.flat_phases().serialize(), seq=board.link.stream_next
    )
    others = [
        data
        for name, data in malformed_frames.malformed_checksums(body).items()
        if name != "no checksum"
    ]
    frames = [malformed_frames.malformed_with_wrong_crc(body, flip) for flip in flips] + others
    for bit in (0, 13, 77, 100):  # damage in the body instead
        damaged = bytearray(malformed_frames.malformed_with_crc(body))
        damaged[bit // 8] ^= 1 << bit % 8
        frames.append(bytes(damaged))
    long = [
        frame
        for frame in [*frames, malformed_frames.malformed_with_wrong_crc(stream)]
        if len(frame) >= 14
    ]
    with board.counting(crc=len(long), dropped_state=1):
        board.link.unanswered(
            "a frame with a wrong CRC", *map(malformed_frames.malformed_frame, long)
        )
        # Its number is still free: the next frame takes it, without a gap or a duplicate.
        board.link.stream(board.flat_phases())


@case("HG-2.4/2-lease", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def wrong_checksums_renew_no_lease(board: BoardClient) -> None:
    """frames with a wrong CRC do not keep an ARMED board alive"""
    timeout_ms = 200
    board.configure(host_timeout_ms=timeout_ms)
    body = board.link.body(Ping.TYPE, bytes(8), seq=board.link.next_seq())
    board.arm()
    since = board.link.mark()
    for _ in range(2 * timeout_ms // 40):
        board.link.send(
            malformed_frames.malformed_frame(malformed_frames.malformed_with_wrong_crc(body))
        )
        board.wire.idle(40_000)
    board.wire.idle_beyond(0)
    judge_lease_ends(board, since, "damaged frames have renewed the lease")
