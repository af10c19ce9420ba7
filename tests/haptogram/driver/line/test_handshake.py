import pytest

from haptogram.driver.driver import Driver
from haptogram.errors import DeviceError, NoAnswerError, VersionMismatchError, WrongProtocolError
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Error, ErrorCode, MessageType, Status, build_body
from virtual_ports import BoardPort, ScriptedPort


def error_reply(code, detail):
    body = build_body(Error(MessageType.HELLO, code, detail), flags=0, seq=0, time_us=0, session=0)
    return encode_frame(body)


def refused(port, error, text):
    with pytest.raises(error, match=text) as caught:
        Driver(port, timeout_s=1.0)
    assert port.closed
    assert "\n" not in str(caught.value)
    return caught.value


def test_silence():
    port = ScriptedPort()
    refused(port, NoAnswerError, "scripted://port: nothing came back within 1 s")
    assert 1e9 <= port.now_ns() < 1.01e9


def test_another_device_or_another_rate():
    text = "16 bytes came within 1 s, but no Haptogram frame: another device, or another rate than"
    refused(ScriptedPort(b"login: \x00password"), WrongProtocolError, text)


def test_an_endless_flood_of_noise():
    noise = b"\x55\xaa\x00garbage" * 100

    class Flood(ScriptedPort):
        def read_available(self, _):
            self._t_ns += 1_000_000
            return noise

    refused(Flood(), WrongProtocolError, "no Haptogram frame")


def test_an_echo():
    port = ScriptedPort(*[lambda data: data] * 9)
    refused(port, WrongProtocolError, "sends back what is written to it")


def test_a_board_of_another_major_version():
    port = ScriptedPort(error_reply(ErrorCode.VERSION, 7))
    refused(
        port, VersionMismatchError, "board speaks version 7 of the protocol, this host version 2"
    )


def test_a_board_that_refuses_otherwise():
    port = ScriptedPort(error_reply(ErrorCode.FAULT, 3))
    error = refused(port, DeviceError, "HELLO was refused: FAULT, detail 3")
    assert (error.code, error.detail) == (ErrorCode.FAULT, 3)


def test_an_error_code_of_a_later_version_has_a_number():
    refused(ScriptedPort(error_reply(99, 0)), DeviceError, "error 99")


def test_frames_of_an_old_session_are_no_answer():
    with Driver(BoardPort(), nonce=5) as driver:
        status = driver.status()
    event = Status(*(getattr(status, name) for name in Status.WIRE))
    frame = encode_frame(build_body(event, flags=0, seq=9, time_us=1, session=5))
    refused(ScriptedPort(frame), NoAnswerError, "frames came within 1 s, but no answer to HELLO")


def test_garbage_around_the_answer_does_no_harm():
    port = BoardPort(tamper=lambda data: b"\x13noise\x00\x07" + data + b"\x99more")
    with Driver(port) as driver:
        assert driver.identity.firmware == "haptogram-sim 1"
        assert driver.arm().name == "ARMED"


def test_a_hello_that_was_lost_is_sent_again():
    lost = []

    def tamper(data):
        if len(lost) < 2:
            lost.append(data)
            return b""
        return data

    with Driver(BoardPort(tamper=tamper)) as driver:
        assert lost[0] == lost[1]
        assert driver.identity.nonce == driver.session


def test_a_second_session_takes_the_board_over():
    port = BoardPort()
    first = Driver(port, nonce=1)
    first.arm()
    with Driver(port, nonce=2) as second:
        assert second.status().reason.name == "NEW_SESSION"
        second.arm()
        second.focus((0, 0, 0.15))
        assert second.read_drive().key.session == 2
