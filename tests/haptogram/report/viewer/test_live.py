"""The live view: real records of a board in virtual time, a real server, real sockets."""

from __future__ import annotations

import contextlib
import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import serial

import haptogram
import sim_device
from haptogram.cli import main
from haptogram.driver.driver import Driver
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import BackdoorReader, board_model_of_evidence
from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.html import render_document_page
from haptogram.report.viewer.live import KEPT, LiveViewerScene
from haptogram.report.viewer.scene import view_document
from haptogram.report.viewer.server import ViewServer

from .test_scene import unpack

CAPTURES = Path(__file__).parents[3] / "data" / "dialects"
PLACES = [(0.02, 0.0, 0.1), (0.0, 0.02, 0.12), (-0.02, 0.0, 0.1)]


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """What a board of 8 x 8 told while it showed three foci."""
    path = tmp_path_factory.mktemp("board") / "records"
    sim_device.register_url_handler()
    url = f"haptogram://?array=8x8&clock=virtual&reconstruct=1&seed=2&backdoor={path}"
    with Driver(url, seed=1) as driver:
        driver.arm()
        driver.stream(PLACES, rate_hz=500)
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.fixture
def scene(records: list[dict[str, Any]]) -> LiveViewerScene:
    live = LiveViewerScene(records[0])
    live.take(records[1:])
    return live


@pytest.fixture
def server(records: list[dict[str, Any]]) -> Iterator[ViewServer]:
    page = render_document_page(view_document(None, title="Live view", lead=[]), UNSTATED)
    started = ViewServer(page, LiveViewerScene(records[0]))
    yield started
    started.close()


def take(server: ViewServer, records: list[dict[str, Any]], *, ended: bool = False) -> None:
    assert server.scene is not None
    server.take(server.scene, records, ended=ended)


def test_the_array_is_there_before_the_first_frame(
    server: ViewServer, records: list[dict[str, Any]], open_page: Callable[..., Any]
) -> None:
    page = open_page(server.address)
    view = "() => [haptogramViewer.scene.elements, haptogramViewer.scene.frames]"
    assert page.evaluate(view) == [64, 0]
    assert page.locator("[data-part=failure]").inner_text() == "Nothing has been radiated yet."
    drawn = """() => {
      const { context, canvas: { width, height } } = haptogramViewer.picture;
      return new Set(context.getImageData(0, 0, width, height).data).size;
    }"""
    assert page.evaluate(drawn) > 5
    page.click("[data-part=play]")
    take(server, records[1:])
    page.wait_for_function("() => haptogramViewer.scene.frames === 3")
    page.wait_for_function("() => haptogramViewer.frame === 2")
    assert page.evaluate("() => haptogramViewer.scene.startUs > 0")


class Answer(NamedTuple):
    status: int
    policy: str | None
    body: bytes


def ask(
    server: ViewServer, path: str, host: str | None = None, origin: str | None = None
) -> Answer:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    with contextlib.closing(connection):
        told = {"Host": host, "Origin": origin}
        headers = {name: text for name, text in told.items() if text is not None}
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return Answer(answer.status, answer.headers["Content-Security-Policy"], answer.read())


# --- records ------------------------------------------------------------------------------------


def test_scene_holds_what_the_board_radiated(scene: LiveViewerScene) -> None:
    header, columns = unpack(scene.since(0))
    assert header["shown"] == scene.shown == len(columns["number"]) >= len(PLACES)
    found = columns["found_mm"][: len(PLACES)]
    np.testing.assert_allclose(found, 1e3 * np.array(PLACES), atol=1.0)
    assert (columns["phases"] != 0).any()
    assert header["counters"]["latched"] == scene.shown
    assert header["counters"]["state"].startswith("MUTED")


def test_only_new_frames_are_told(scene: LiveViewerScene) -> None:
    every = unpack(scene.since(0))[1]["number"].tolist()
    for shown in range(scene.shown + 3):
        assert unpack(scene.since(shown))[1]["number"].tolist() == every[shown:]


def test_memory_is_bounded(records: list[dict[str, Any]]) -> None:
    live = LiveViewerScene(records[0])
    latches = [record for record in records if record["kind"] == "latch"]
    while live.shown <= KEPT:
        live.take(latches * 500)
    assert len(unpack(live.whole().pack())[1]["number"]) == KEPT


def test_model_is_that_of_the_board(records: list[dict[str, Any]]) -> None:
    expected = haptogram.acoustics.AcousticModel.default(8, 8)
    model = board_model_of_evidence(records[0])
    np.testing.assert_array_equal(model.array.positions_m, expected.array.positions_m)
    assert model.medium == expected.medium
    assert model.transducer == expected.transducer


@pytest.mark.parametrize(
    "lines",
    [
        *(b"no json\n", b"[1]\n", b"{}\n", b'{"kind": "latch"}\n', b'{"kind": "board"}\n'),
        100_000 * b"[" + b"\n",
    ],
    ids=["text", "list", "no kind", "a latch first", "an empty board", "deep"],
)
def test_other_files_are_refused_in_one_line(lines: bytes, tmp_path: Path) -> None:
    path = tmp_path / "records"
    path.write_bytes(lines)
    with BackdoorReader(str(path)) as stream, pytest.raises(ConfigurationError) as refused:
        LiveViewerScene(stream.read()[0])
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "strange",
    [{"kind": "output"}, {"kind": "end"}, {"kind": "latch"}, {"kind": "latch", "cut": True}],
    ids=str,
)
def test_strange_records_are_refused_in_one_line(
    strange: dict[str, Any], records: list[dict[str, Any]]
) -> None:
    live = LiveViewerScene(records[0])
    if "cut" in strange:
        strange = next(record for record in records if record["kind"] == "latch")
        strange = strange | dict.fromkeys(("phase_codes", "amplitude_codes"), "AAAA")
    with pytest.raises(ConfigurationError, match="back door"):
        live.take([strange])


def test_file_is_followed_line_by_line(records: list[dict[str, Any]], tmp_path: Path) -> None:
    path = tmp_path / "records"
    path.touch()
    read = []
    data = b"".join(json.dumps(record).encode() + b"\n" for record in records)
    with BackdoorReader(str(path)) as stream, path.open("ab", buffering=0) as file:
        for start in range(0, len(data), 700):  # lines are cut anywhere
            file.write(data[start : start + 700])
            read += stream.read()
    assert read == records


# --- server -------------------------------------------------------------------------------------


def test_frames_come_as_a_page_asks_for_them(
    server: ViewServer, records: list[dict[str, Any]]
) -> None:
    assert unpack(ask(server, "/frames?after=0").body)[0]["shown"] == 0
    take(server, records[1:])
    header, columns = unpack(ask(server, "/frames?after=1").body)
    assert columns["number"].tolist() == list(range(1, header["shown"]))


def test_only_this_machine_by_its_own_name_is_answered(server: ViewServer) -> None:
    for host in (f"127.0.0.1:{server.port}", f"localhost:{server.port}"):
        assert ask(server, "/", host).status == 200
    for host in ("evil.example", f"evil.example:{server.port}", "127.0.0.1:1", ""):
        assert ask(server, "/", host).status == 403
    assert ask(server, "/etc/passwd").status == 404


@pytest.mark.parametrize("path", ["/", "/frames?after=0"])
def test_a_page_of_another_origin_is_not_answered(server: ViewServer, path: str) -> None:
    host = f"127.0.0.1:{server.port}"
    assert ask(server, path, host, origin=f"http://{host}").status == 200
    for origin in ("http://evil.example", f"https://{host}", "null", ""):
        assert ask(server, path, host, origin=origin).status == 403


@pytest.mark.parametrize(
    "name",
    [
        "<script>window.obeyed = 1</script>",
        "</script><svg onload='window.obeyed = 1'>",
        "\x00\x1b[31mred\u202e",
        10_000 * "A",
    ],
    ids=["script", "end of script", "control characters", "long"],
)
def test_a_page_shows_the_name_of_a_board_and_does_not_obey_it(
    name: str, records: list[dict[str, Any]], tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    source, path = tmp_path / "board.jsonl", tmp_path / "view.html"
    told = [records[0] | {"firmware": name}, *records[1:]]
    source.write_text("".join(json.dumps(record) + "\n" for record in told))
    assert main(["view", str(source), "--html", str(path)]) == 0
    assert not set("\x00\x1b\u202e") & set(path.read_text(encoding="utf-8"))
    page = open_page(path.as_uri(), viewport={"width": 400, "height": 900})
    assert page.evaluate("() => window.obeyed ?? null") is None
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 400
    assert page.locator(".banner").bounding_box()["height"] < 900


def test_other_machines_need_the_token(records: list[dict[str, Any]]) -> None:
    server = ViewServer("<p>page</p>", LiveViewerScene(records[0]), "0.0.0.0")
    try:
        token = re.fullmatch(r"http://0\.0\.0\.0:\d+(/[\w-]{22}/)", server.address)
        assert token
        assert ask(server, token[1]).status == 200
        for path in ("/", "/frames", token[1][:-2] + "/", token[1].upper() + "x"):
            assert ask(server, path).status == 404
    finally:
        server.close()


def test_page_may_run_its_own_script_only(server: ViewServer) -> None:
    policy = ask(server, "/").policy
    assert policy is not None
    assert "default-src 'none'" in policy
    assert policy.count("sha256-") == 3  # the view, the tables, the style
    assert "unsafe" not in policy


def test_readers_that_are_slow_or_gone_hold_nobody_up(
    server: ViewServer, records: list[dict[str, Any]]
) -> None:
    deaf = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(20)]
    for one in deaf:
        host = f"Host: localhost:{server.port}".encode()
        one.sendall(b"GET /frames?after=0 HTTP/1.1\r\n" + host + b"\r\n\r\n")  # and never reads
    latches = [record for record in records if record["kind"] == "latch"]
    take(server, latches * 700)  # more than the buffers of a socket hold
    assert unpack(ask(server, "/frames?after=0").body)[0]["shown"] > 0
    for one in deaf:
        one.close()
    assert ask(server, "/").status == 200


def test_port_that_is_taken_is_named(server: ViewServer) -> None:
    with pytest.raises(ConfigurationError, match=f"127.0.0.1:{server.port}: cannot .*name another"):
        ViewServer("<p>page</p>", port=server.port)


def test_strange_requests_are_refused_in_silence(
    server: ViewServer, capfd: pytest.CaptureFixture[str]
) -> None:
    for target in (b"http://[", b"//[", b"/frames?after=" + 9000 * b"9", b"\xff"):
        with socket.create_connection(("127.0.0.1", server.port)) as one:
            one.sendall(b"GET " + target + b" HTTP/1.1\r\nHost: x\r\n\r\n")
            assert one.recv(100).startswith(b"HTTP/1.1 4")
    assert capfd.readouterr().err == ""


# --- browser ------------------------------------------------------------------------------------


_DELAYS = """() => {
  const wait = window.setTimeout;
  window.delays = [];
  window.setTimeout = (act, ms) => { delays.push(ms); return wait(act, ms); };
}"""


@pytest.mark.parametrize(("motion", "pause_ms"), [("reduce", 1000), ("no-preference", 50)])
def test_who_asked_for_little_motion_gets_a_picture_a_second(
    motion: str,
    pause_ms: int,
    server: ViewServer,
    records: list[dict[str, Any]],
    open_page: Callable[..., Any],
) -> None:
    take(server, records[1:])
    page = open_page(server.address, reduced_motion=motion)
    page.add_init_script(f"({_DELAYS})()")
    page.reload()
    page.wait_for_function("() => delays.length")
    assert set(page.evaluate("() => delays")) == {pause_ms}


def test_page_follows_the_board(
    server: ViewServer, records: list[dict[str, Any]], open_page: Callable[..., Any]
) -> None:
    latches = [record for record in records if record["kind"] == "latch"]
    take(server, latches[:1])
    page = open_page(server.address)
    frames = "() => haptogramViewer.scene.frames"
    for count in (2, 3):
        take(server, latches[count - 1 : count])
        page.wait_for_function(f"() => haptogramViewer.scene.frames === {count}")
        assert page.evaluate("() => haptogramViewer.frame") == count - 1
    inside = """() => {
      const { picture, scene, frame } = haptogramViewer;
      const [x, y] = haptogramViewer.pixelOf(scene.row("found_mm", frame));
      return x > 0 && y > 0 && x < picture.view.width && y < picture.view.height;
    }"""
    assert page.evaluate(inside)  # the picture grows with what it shows
    late = open_page(server.address)  # whoever comes later begins with the newest frame
    assert late.evaluate("() => haptogramViewer.frame") == 2
    page.click("[data-part=back]")  # who looks at a frame keeps it
    take(server, latches[:1] * 5)
    page.wait_for_function("() => haptogramViewer.scene.frames === 8")
    assert page.evaluate("() => haptogramViewer.frame") == 1
    assert page.evaluate(frames) == 8
    take(server, [], ended=True)
    page.wait_for_function(
        "() => document.querySelector('[data-part=failure]').textContent.includes('has ended')"
    )


# --- command ------------------------------------------------------------------------------------


@pytest.fixture
def file(records: list[dict[str, Any]], tmp_path: Path) -> Path:
    path = tmp_path / "board.jsonl"
    path.write_text("".join(json.dumps(record) + "\n" for record in records))
    return path


def test_command_writes_a_page(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(file), "--html", str(tmp_path / "page.html")]) == 0
    assert capsys.readouterr().out == ""
    assert 'id="scene"' in (tmp_path / "page.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["unix:/nowhere/socket"], "no board listens at unix:/nowhere/socket"),
        (["/nowhere/file"], "'/nowhere/file' cannot be read: there is no such file"),
        (["FILE", "--http", "localhost:1"], "--http is 'localhost:1', must be an IPv4 address"),
        (["FILE", "--http", "127.0.0.1:70000"], "the port must be 0 to 65535"),
        (["FILE", "--html", "FILE"], "--html"),
        (["unix:/nowhere/socket", "--html", "page.html"], "a socket tells only what comes"),
    ],
)
def test_command_refuses_in_one_line(
    arguments: list[str], told: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = file.read_bytes()
    assert main(["view", *(str(file) if word == "FILE" else word for word in arguments)]) == 2
    complaint = capsys.readouterr().err
    assert told in complaint
    assert complaint.count("\n") == 1
    assert file.read_bytes() == before


def test_command_serves_until_it_is_interrupted(file: Path) -> None:
    command = [sys.executable, "-m", "haptogram", "view", str(file), "--no-open"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        address = process.stdout.readline().removeprefix("view at http://").strip(" /\n")
        connection = http.client.HTTPConnection(address, timeout=20)
        with contextlib.closing(connection):
            shown = 0
            while not shown:
                connection.request("GET", "/frames?after=0")
                shown = unpack(connection.getresponse().read())[0]["shown"]
                time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
        assert process.returncode == 0
        assert "Traceback" not in errors


def _frames(connection: http.client.HTTPConnection) -> tuple[dict[str, Any], dict[str, Any]]:
    connection.request("GET", "/frames?after=0")
    return unpack(connection.getresponse().read())


@pytest.mark.nightly
def test_board_and_verify_show_themselves(tmp_path: Path) -> None:
    board = [sys.executable, "-m", "haptogram", "board", "--link", str(tmp_path / "board")]
    verify = [sys.executable, "-m", "haptogram", "verify", "--object", "point", "--array", "4x4"]
    for command, ended in ((board, 0), ([*verify, "--repeat", "20000"], None)):
        with subprocess.Popen(
            [*command, "--view", "--quiet"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        ) as process:
            assert process.stdout is not None
            if command is board:
                assert process.stdout.readline() == f"listening on {tmp_path / 'board'}\n"
            address = process.stdout.readline()
            assert re.fullmatch(r"view at http://127\.0\.0\.1:\d+/\n", address)
            connection = http.client.HTTPConnection(address.split("/")[2], timeout=20)
            with contextlib.closing(connection):
                header, columns = _frames(connection)
                assert header["phase_steps"] == 256
                for _ in range(100 * (command is not board)):
                    if len(columns["number"]):
                        break
                    time.sleep(0.1)
                    columns = _frames(connection)[1]
                assert len(columns["number"]) or command is board
            process.terminate()
            process.communicate(timeout=60)
            assert ended is None or process.returncode == ended
            with pytest.raises(ConnectionRefusedError):
                connection.connect()  # the view has ended with the one who started it


def test_pulses_of_another_board_are_shown(tmp_path: Path) -> None:
    sim_device.register_url_handler()
    path = tmp_path / "records"
    port = serial.serial_for_url(
        f"haptogram://?dialect=sonicsurface&clock=virtual&reconstruct=1&backdoor={path}"
    )
    port.write((CAPTURES / "sonicsurface" / "focus_20_150_m15.bin").read_bytes())
    port.timeout = 0.1
    assert port.read(1) == b""  # the board never answers; the line takes its time
    port.close()
    first, *others = [json.loads(line) for line in path.read_text().splitlines()]
    live = LiveViewerScene(first)
    live.take(others)
    header, columns = unpack(live.since(0))
    # The client means (20, 150, -15) mm, y up; its rows begin 2 mm off the centre of the array.
    np.testing.assert_allclose(columns["found_mm"][-1], (20.0, 15.0, 150.0), atol=3.0)
    # A board without states has none, and what only the watch needs is not counted.
    counted = {"latched": 2, "no single focus": 1, "power down": 1}
    assert header["counters"] == counted | {"board": "sonicsurface"}
    assert np.transpose(header["client_axes"]) @ (20.0, 15.0, 150.0) == pytest.approx(
        (20, 150, -15)
    )
    live.take([{"kind": "output", "event": "remark", "about": "client", "text": "a hint"}])
    assert unpack(live.since(0))[0]["counters"]["remark"] == "a hint"
