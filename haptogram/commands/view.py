"""``haptogram view``: a running board, or a recording, in a browser."""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import os
import select
import sys
import time
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError
from haptogram.settings.parser import Acting, Parser, add_file_option, add_flag, checked_option_type

from .acting_options import refuse_idle_options
from .shell.exit_status import PASS, USAGE
from .shell.output_files import CommandOutputs

if TYPE_CHECKING:
    from haptogram.evidence.backdoor import BackdoorReader
    from haptogram.report.formats.document import Document
    from haptogram.report.viewer.live import LiveViewerScene
    from haptogram.report.viewer.server import ViewServer

_PERIOD_S: Final = 0.05  # time between two reads of the back door: 20 pictures a second at most
_AT_ONCE: Final = 1 << 16
_NICENESS: Final = 10  # the 1 kHz loop comes first
_PATIENCE_S: Final = 30.0  # wait for a board that is being started
_DESKTOPS: Final = ("DISPLAY", "WAYLAND_DISPLAY")


_ACTING: Final = dict.fromkeys(
    ("http", "open", "until_eof"),
    Acting("on a page that is served (not with --html)", lambda s: s.html is None),
)


def set_up_view(parser: Parser) -> None:
    """Add the options of the command."""
    parser.acting = _ACTING
    parser.set_defaults(run=run_view)
    parser.add_argument(
        "source",
        metavar="SOURCE",
        help="a recording, FILE.mcap, or the back door of a board: unix:PATH, or the file that the "
        "board appends to",
    )
    parser.add_argument(
        "--http",
        type=checked_option_type(_view_address, "HOST:PORT"),
        default=("127.0.0.1", 0),
        metavar="HOST:PORT",
        help="where browsers find the page; port 0 takes any. With an address that others can "
        "reach, a browser needs the token that is printed [127.0.0.1:0]",
    )
    parser.add_argument(
        "--open",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="open the page in a browser [where there is a desktop]",
    )
    add_flag(
        parser,
        "--until-eof",
        help="end when standard input ends: with the program that started this one",
    )
    add_file_option(
        parser,
        "--html",
        help="write the recording, or what the back door holds now, as a page, and serve none "
        "[none]",
    )


def run_view(arguments: argparse.Namespace) -> int:
    """Serve or write the page; return the exit status."""
    from haptogram.report.formats.html import check_html_page

    refuse_idle_options(arguments)
    outputs = CommandOutputs(arguments, "html")
    check_html_page()
    if arguments.html is not None and arguments.source.startswith("unix:"):
        raise ConfigurationError(
            "--html writes what a file holds; a socket tells only what comes: name the file of "
            "--backdoor or a recording, or leave --html out"
        )
    if arguments.source.endswith(".mcap"):
        return _view_recording(arguments, outputs)
    return _view_board(arguments, outputs)


def _view_recording(arguments: argparse.Namespace, outputs: CommandOutputs) -> int:
    """Write a page of a recording's frames with --html, else serve it; return the exit status."""
    from haptogram.report.viewer.recorded import viewer_scene_of_recording
    from haptogram.report.viewer.scene import view_document

    recorded = viewer_scene_of_recording(Path(arguments.source))
    document = view_document(
        recorded.scene,
        title=Path(arguments.source).name,
        lead=recorded.lead,
        verdict=recorded.verdict,
    )
    if arguments.html is None:
        return _serve_view(arguments, document, outputs)
    return PASS if outputs.write(document) else USAGE


def _view_board(arguments: argparse.Namespace, outputs: CommandOutputs) -> int:
    """Serve a live page of a board's back door, or write one (--html); return the exit status."""
    from haptogram.evidence.backdoor import BackdoorReader
    from haptogram.report.viewer.live import LiveViewerScene
    from haptogram.report.viewer.scene import view_document

    with BackdoorReader(arguments.source) as stream:
        first, *others = stream.read_first(_PATIENCE_S)
        scene = LiveViewerScene(first)
        scene.take(others)
        if arguments.html is None:
            lead = [f"{scene.firmware}, {scene.model.array.count} transducers."]
            document = view_document(None, title="Live view", lead=lead)
            return _serve_view(arguments, document, outputs, (scene, stream))
        while records := stream.read():
            scene.take(records)
    document = view_document(scene.whole(), title=scene.firmware, lead=scene.lead)
    return PASS if outputs.write(document) else USAGE


def _serve_view(
    arguments: argparse.Namespace,
    document: Document,
    outputs: CommandOutputs,
    live: tuple[LiveViewerScene, BackdoorReader] | None = None,
) -> int:
    """Serve a page until Ctrl-C or the starting program ends it; return the exit status.

    *live* is the scene and back door whose records are followed; None: the page stays as it is.
    """
    from haptogram.report.formats.html import render_document_page
    from haptogram.report.viewer.server import ViewServer

    page = render_document_page(document, outputs.provenance)
    server = ViewServer(page, live and live[0], *arguments.http)
    with contextlib.suppress(OSError, AttributeError):  # a system without priorities
        os.nice(_NICENESS)
    try:
        print(f"view at {server.address}", flush=True)
        if _wants_view_in_browser(arguments.open):
            webbrowser.open(server.address)
        while not arguments.until_eof or _is_starter_there():
            if live is not None:
                _follow_view(server, *live, is_started=arguments.until_eof)
            time.sleep(_PERIOD_S)
    except KeyboardInterrupt:
        pass
    finally:
        server.close()
    return PASS


def _follow_view(
    server: ViewServer, scene: LiveViewerScene, stream: BackdoorReader, *, is_started: bool
) -> None:
    """Pass new records to the view's server; once the board has ended, do nothing.

    *is_started*: a program started the view, so that no hint at Ctrl-C is printed.
    """
    if scene.ended:
        return
    records = stream.read()
    if records or not stream.is_open:
        server.take(scene, records, ended=not stream.is_open)
    if scene.ended and not is_started:
        print("the board has ended; Ctrl-C ends the view", file=sys.stderr)


def _is_starter_there() -> bool:
    """Return False if standard input has ended or is closed: the starting program is gone."""
    if sys.stdin is None:
        return False
    while select.select([sys.stdin], [], [], 0.0)[0]:
        if not os.read(sys.stdin.fileno(), _AT_ONCE):
            return False
    return True


def _wants_view_in_browser(wish: bool | None) -> bool:
    """Return True if a browser is to open: by *wish* or, if None, where there is a desktop."""
    if wish is None:
        return sys.platform in ("darwin", "win32") or any(map(os.environ.get, _DESKTOPS))
    return wish


def _view_address(text: str) -> tuple[str, int]:
    """Return IPv4 address and port of a text ADDRESS:PORT; ConfigurationError for any other."""
    host, _, port = text.rpartition(":")
    try:
        ipaddress.IPv4Address(host)
    except ValueError:
        raise ConfigurationError(f"is {text!r}, must be an IPv4 address and a port") from None
    if not (port.isdecimal() and len(port) < 6 and int(port) < 1 << 16):
        raise ConfigurationError(f"is {text!r}, the port must be 0 to 65535")
    return host, int(port)
