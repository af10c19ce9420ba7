import re

import pytest

from haptogram.campaigns.bench.frame_budget import (
    bench_frame_formats,
    measure_budget_wake_ns,
    measure_frame_budget,
)
from haptogram.cli import main
from haptogram.driver.line.budget import frame_bytes_on_line
from haptogram_protocol import encode_frame
from haptogram_protocol.messages import build_body


@pytest.mark.parametrize("transducers", [1, 64, 256, 1024])
def test_every_format_is_budgeted_as_long_as_its_longest_frame(transducers):
    for name, message in bench_frame_formats(transducers).items():
        body = build_body(message, flags=0, seq=1, time_us=1, session=1)
        budget = measure_frame_budget(name, message, baudrate=3_000_000)
        assert len(encode_frame(body)) <= budget.size == frame_bytes_on_line(len(body) - 10)
        assert min(budget.encode_ns, budget.write_ns, budget.decode_ns) > 0
        assert budget.wire_ns == -(-budget.size * 10**10 // 3_000_000)
        assert budget.highest_hz == min(budget.line_hz, budget.host_hz)


def test_the_lead_is_the_sum_of_the_stages():
    message = bench_frame_formats(256)["phases"]
    budget = measure_frame_budget("x", message, baudrate=921_600)
    stages = budget.encode_ns + budget.write_ns + budget.wire_ns + budget.decode_ns
    assert budget.latency_ns(50_000) == 50_000 + stages + 25_000


def test_a_loop_is_never_early():
    assert measure_budget_wake_ns(1000) >= 0


def test_the_command_says_what_fits_and_what_does_not(capsys):
    """Whatever this machine is busy with: the host's share and the widths are measured."""
    status = main(["budget", "--baud", "3000000", "--rate-hz", "1000"])
    text = capsys.readouterr().out
    assert re.search(r"wire +913\.3 µs +91\.3 %  274 bytes of 10 bits at 3000000 baud", text)
    assert "the line is 91.3 % full" in text
    assert ("1000 Hz fits: " in text, "1000 Hz does not fit: " in text) == (
        status == 0,
        status == 1,
    )
    for name in bench_frame_formats(256):
        assert name in text
    assert re.search(r"latency timer of 16 ms, as it comes +16193\.3 µs", text)
    assert main(["budget", "--rate-hz", "0.1"]) == 0
    assert "0.1 Hz fits: " in capsys.readouterr().out
    assert main(["budget", "--baud", "9600", "--rate-hz", "1000"]) == 1
    text = capsys.readouterr().out
    assert "1000 Hz does not fit: " in text
    assert re.search(r"\nphases .* 4 Hz +line", text)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--rate-hz", "0"], "--rate-hz is 0, must be 0.001 to 40000 Hz"),
        (["--rate-hz", "nan"], "--rate-hz is nan, must be"),
        (["--baud", "0"], "--baud is 0, must be"),
        (["--transducers", "0"], "--transducers is 0, must be 1 to 1024"),
    ],
)
def test_what_makes_no_sense_is_one_line(capsys, arguments, text):
    assert main(["budget", *arguments]) == 2
    error = capsys.readouterr().err
    assert text in error
    assert error.count("\n") == 1
