"""Boards of other dialects as processes: real ports, the bytes of unmodified clients, records."""

import base64
import os
import sys

import numpy as np
import pytest
import serial

from dialect_boards import EXPECTED, capture
from haptogram import VirtualBoard
from haptogram.cli import main
from haptogram.errors import ConfigurationError

pytestmark = pytest.mark.pty
BAUDS = (115_200, 230_400, 250_000, 1_462_857, 1_500_000)
FOCUS = "sonicsurface/focus_0_120_0"


def codes_of(record):
    rises, widths = (
        np.frombuffer(base64.b64decode(record[name]), "<u2") for name in ("rises", "widths")
    )
    return np.where(widths > 0, rises, record["steps"]).tolist()


def test_a_client_on_a_pty_is_understood_at_every_rate_and_at_full_speed():
    with VirtualBoard(dialect="sonicsurface", reconstruct=False) as board:
        for baud in BAUDS:
            with serial.Serial(board.url, baud, timeout=1) as port:
                port.write(capture(FOCUS))
                port.flush()
        assert board.wait_for(1 + len(BAUDS))
        descriptor = os.open(board.url, os.O_WRONLY | os.O_NOCTTY)
        try:  # as fast as the kernel takes it, and no client there any more
            os.write(descriptor, capture(FOCUS) * 8)
        finally:
            os.close(descriptor)
        assert board.wait_for(1 + len(BAUDS) + 8)
        board.stop()
        first, *latches, end = [r for r in board.records() if r["kind"] != "output"]
    assert first["dialect"] == "sonicsurface"
    assert first["baud"] == 230_400
    assert end["clean"]
    assert end["latched"] == len(latches)
    assert [latch["cause"] for latch in latches] == ["power-up", *["swap"] * (len(latches) - 1)]
    assert all(codes_of(latch) == EXPECTED[FOCUS]["codes"] for latch in latches[1:])
    assert not any(latch["counted"] for latch in latches)
    times = np.diff([latch["t_latch_us"] for latch in latches[1 + len(BAUDS) :]])
    assert (times >= 11_197).all()  # 258 bytes at 230 400 baud, however fast they came


@pytest.mark.nightly
def test_the_field_is_rebuilt_in_the_model_of_the_board():
    with VirtualBoard(dialect="sonicsurface") as board, serial.Serial(board.url) as port:
        port.write(capture(FOCUS))
        assert board.wait_for(2)
        found = board.records()[-1]["reconstruction"]
        assert board.model.array.count == 256
    assert found["kind"] == "single_focus"
    assert np.linalg.norm(np.array(found["position_m"]) - [0, 0, 0.12]) < 2e-3


def test_what_is_no_dialect_is_one_line():
    with pytest.raises(ConfigurationError, match="'sonic'; known are autd3") as refused:
        VirtualBoard(dialect="sonic")
    assert "\n" not in str(refused.value)


@pytest.mark.nightly
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux tells the rate")
def test_a_client_with_a_rate_that_no_board_has_is_told_once_for_each():
    with VirtualBoard(dialect="sonicsurface", reconstruct=False) as board:
        for baud in (230_400, 9_600, 9_600, 1_462_857, 115_200):
            with serial.Serial(board.url, baud) as port:
                latches = sum(r["kind"] == "pulses" for r in board.records())
                port.write(b"\xfd")
                assert board.wait_for(latches + 1)
        board.stop()
        told = [r["text"] for r in board.records() if r.get("event") == "remark"]
    assert [text for text in told if "9600 baud" in text or "115200 baud" in text] == told
    assert len(told) == 2


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("fault", "status"), [((), 0), (("device.dead transducer=17",), 1)])
def test_verify_judges_an_emulated_board_at_a_port_by_its_back_door(fault, status, capsys):
    with VirtualBoard(dialect="sonicsurface", faults=fault, reconstruct=False) as board:
        words = ["--dialect", "sonicsurface", "--object", "point", "--center-mm", "20,10,150"]
        words += ["--repeat", "3", "--port", board.url, "--backdoor", str(board.backdoor)]
        assert main(["verify", *words, "--quiet"]) == status
        out = capsys.readouterr().out
        assert ("PASS: " if status == 0 else "element 17") in out
        assert main(["verify", *words, "--quiet"]) == status  # what came before is left out


def test_a_back_door_without_a_port_is_refused(capsys):
    assert main(["verify", "--backdoor", "door.jsonl"]) == 2
    assert "--backdoor" in capsys.readouterr().err
