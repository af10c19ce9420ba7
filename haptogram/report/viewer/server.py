"""Serves a view to browsers: its page, and the frames of a running board that each page asks for.

A page asks for the next frames when it has drawn the last ones, so one that is slow or gone costs
nothing: no picture waits for it, and none is kept for it alone.
"""

from __future__ import annotations

import base64
import hashlib
import http.server
import ipaddress
import re
import secrets
import sys
import threading
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import parse_qs

from haptogram.errors import ConfigurationError, plain_reason

from .live import LiveViewerScene

_DEFAULT_PORT: Final = 80  # which a browser leaves out of the Host header
_PATIENCE_S: Final = 1.0  # wait of a page for frames before it gets an empty answer
_INLINE: Final = re.compile(r"<(script type=\"module\"|style)>(.*?)</(?:script|style)>", re.DOTALL)


class ViewServer:
    """Serves one view on a port of this machine.

    On an address that others can reach, pages need the token that is in the address.

    Parameters
    ----------
    page : str
        The page.
    scene : LiveViewerScene, optional
        The running board that the page shows, if it has no scene of its own.
    host : str
        Address to listen on.
    port : int
        Port to listen on; 0 takes any.

    Attributes
    ----------
    address : str
        URL for a browser.

    Raises
    ------
    ConfigurationError
        If the port cannot be had.
    """

    def __init__(
        self,
        page: str,
        scene: LiveViewerScene | None = None,
        host: str = "127.0.0.1",
        port: int = 0,
    ) -> None:
        self.news = threading.Condition()
        self.scene = scene
        self.page = page
        self.headers = _view_headers(page)
        try:
            self._server = _ViewHttpServer((host, port), _ViewHandler)
        except OSError as error:
            raise ConfigurationError(
                f"--http {host}:{port}: cannot listen there: {plain_reason(error)}; name another"
            ) from error
        self._server.view = self
        self.is_local = ipaddress.ip_address(str(self._server.server_address[0])).is_loopback
        self.path = "/" if self.is_local else f"/{secrets.token_urlsafe(16)}/"
        names = {host, "localhost"}
        self.hosts = {f"{name}:{self.port}" for name in names}
        self.hosts |= names if self.port == _DEFAULT_PORT else set()
        self.address = f"http://{host}:{self.port}{self.path}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """Port that it listens on."""
        return int(self._server.server_address[1])

    def take(self, scene: LiveViewerScene, records: list[dict[str, Any]], *, ended: bool) -> None:
        """Hand records of the back door to *scene*, and wake the pages that wait."""
        with self.news:
            scene.take(records)
            scene.ended |= ended
            self.news.notify_all()

    def frames_after(self, shown: int, patience_s: float = _PATIENCE_S) -> bytes | None:
        """Return the scene of the frames after the first *shown*, or of none if none comes.

        None: the page has its own scene.
        """
        if (scene := self.scene) is None:
            return None
        with self.news:
            self.news.wait_for(lambda: scene.shown > shown or scene.ended, patience_s)
            return scene.since(shown)

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()


class _ViewHttpServer(http.server.ThreadingHTTPServer):
    daemon_threads = True
    view: ViewServer

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a page that is gone: the terminal belongs to the board."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _ViewHandler(http.server.BaseHTTPRequestHandler):
    server: _ViewHttpServer
    protocol_version = "HTTP/1.1"
    timeout = 30.0  # of a connection on which nothing comes

    def do_GET(self) -> None:
        """Answer a request for the page or for frames; refuse every other."""
        view = self.server.view
        path, _, query = self.path.partition("?")
        # A page of another name that leads here (DNS rebinding) must not read what is shown.
        host, origin = self.headers.get("Host"), self.headers.get("Origin")
        # Our own page asks without an origin, or with that of the address that it has.
        is_foreign = origin is not None and origin != f"http://{host}"
        if is_foreign or (view.is_local and host not in view.hosts):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif secrets.compare_digest(path.encode(), view.path.encode()):
            self._answer(view.page.encode(), "text/html; charset=utf-8")
        elif secrets.compare_digest(path.encode(), f"{view.path}frames".encode()):
            patience_s = _PATIENCE_S if query else 0.0  # a page that opens has the array at once
            frames = view.frames_after(_query_frame_count(query), patience_s)
            self._answer(frames, "application/octet-stream")
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _answer(self, content: bytes | None, kind: str) -> None:
        """Send *content*, of MIME type *kind*, with the headers of the view; None: status 404."""
        if content is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.send_response(HTTPStatus.OK)
        for name, value in self.server.view.headers.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: Any) -> None:
        """Say nothing: the terminal belongs to the board."""


def _query_frame_count(query: str) -> int:
    """Return the number "after" in a query: how many frames the page has; 0 without a valid one."""
    text = parse_qs(query).get("after", ["0"])[0]
    return int(text) if text.isdecimal() and len(text) < 16 else 0


def _view_headers(page: str) -> dict[str, str]:
    """Return HTTP headers whose security policy allows only the inline script and style of *page*.

    *page* is the whole HTML text.
    """
    sources: dict[str, list[str]] = {"script": [], "style": []}
    for name, content in _INLINE.findall(page):
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        sources[name.split()[0]].append(f"'sha256-{digest}'")
    policy = (
        "default-src 'none'; connect-src 'self'; img-src data:; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'; "
        f"script-src {' '.join(sources['script'])}; style-src {' '.join(sources['style'])}"
    )
    return {
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }
