"""The virtual board does what table 14.3 of SPEC.md says that an input does, and nothing else."""

import copy
import zlib
from operator import attrgetter

import pytest

from haptogram.conformance.clauses import load_spec_table
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    VERSION_MAJOR,
    Arm,
    Config,
    Disarm,
    Flag,
    GetGeometry,
    GetStatus,
    Hello,
    Mute,
    Phases,
    Ping,
    Play,
    SetConfig,
    StateChanged,
    Stop,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
    build_body,
)
from sim_device.board.settings import BOOT_US, BoardSettings
from sim_device.simulation import Simulation

EFFECTS = {row["input"]: row.keys() - {"input"} for row in load_spec_table("input")}
MODEL = BoardSettings().model
N = MODEL.array.count
NONCE = 0x5EED
CONFIG = Config(
    hold_ms=9000, host_timeout_ms=9000, status_period_ms=1000, trace_mode=TraceMode.DRIVE
)
FAR_US, SLOW_US = 5_000_000, 8_000_000


class Bench:
    """A board that holds something of everything: frames in the queue, or a playback."""

    def __init__(self, *, plays: bool) -> None:
        self.simulation = Simulation(BoardSettings())
        self.seq, self.stream = -1, FIRST_STREAM_SEQ - 1
        data = bytes(N)
        for message in (
            Hello(VERSION_MAJOR, 0, NONCE),
            SetConfig(CONFIG),
            Arm(),
            UploadBegin(UploadKind.PHASES, 0, 1, N, zlib.crc32(data)),
            UploadChunk(0, data),
            UploadCommit(1),
            UploadBegin(UploadKind.PHASES, 0, 2, 2 * N, zlib.crc32(2 * data)),
            UploadChunk(0, data),
        ):
            self.request(message)
        self.frame(flags=Flag.IMMEDIATE)
        self.run(100)
        self.frame(self.now_us + FAR_US)
        if plays:
            self.request(Play(1, SLOW_US, 0, 9000), flags=Flag.IMMEDIATE)
        self.run(1000)

    @property
    def now_us(self) -> int:
        return BOOT_US + self.simulation.now_ns // 1000

    def run(self, us: int) -> None:
        self.simulation.advance_to(self.simulation.now_ns + 1000 * us)

    def run_up_to(self, *actions: str) -> None:
        """Let time pass up to the microsecond before the board does one of *actions*."""
        while True:
            due_us, action = attrgetter("board._next_due")(self.simulation.dialect)()
            if action.__name__ in actions:
                return self.run(due_us - 1 - self.now_us)
            self.run(due_us - self.now_us)

    def reset(self) -> None:
        self.simulation = Simulation(BoardSettings())

    def play_twice(self) -> None:
        self.request(Stop())
        self.request(Play(1, SLOW_US, 2, 9000), flags=Flag.IMMEDIATE)
        self.run(100)

    def send(self, message, seq, **header) -> None:
        fields = {"flags": 0, "time_us": 0, "session": NONCE} | header
        body = build_body(message, seq=seq & 0xFFFF, **fields)
        self.simulation.host_write(encode_frame(body), self.simulation.now_ns)
        self.run(2)

    def request(self, message, **header) -> None:
        self.seq += 1
        session = 0 if isinstance(message, Hello) else NONCE
        self.send(message, self.seq, **{"session": session} | header)

    def frame(self, time_us=0, **header) -> None:
        self.stream += 1
        self.send(Phases(bytes(N)), self.stream, time_us=time_us & 0xFFFFFFFF, **header)

    def complete(self) -> None:
        """Send the rest of the upload, and commit it."""
        self.request(UploadChunk(N, bytes(N)))
        self.request(UploadCommit(2))

    def held(self) -> dict[str, object]:
        """Return what the board holds now."""
        dialect = self.simulation.dialect
        found = {
            held: [copy.deepcopy(attrgetter(name)(dialect)) for name in names]
            for held, names in WHERE.items()
        }
        upload = found["upload"][0]
        return found | {"upload": upload and vars(upload)}


#: Where the virtual board keeps what it holds.
WHERE = {
    "lease": ("board.output._timers._lease.deadline_us",),
    "hold": ("board.output._timers._hold.deadline_us",),
    "queue": ("board.queued",),
    "playback": ("board._playback",),
    "upload": ("board._uploads._pending",),
    "numbers, remembered reply": (
        "_link._control_newest",
        "_link._stream_expected",
        "_link._answered",
    ),
    "last latch, ring": ("board.output.latched", "board.output.latches", "board.output.ring"),
    "divider": ("_traced",),
    "margins": ("board.margins.count",),
    "status timer": ("_next_status_us",),
    "sequences, configuration, correction": (
        "board.output.config",
        "board.output.correction",
        "board._sequences",
    ),
}


OTHER = Config(**{**{name: getattr(CONFIG, name) for name in Config.WIRE}, "hold_ms": 8000})
INPUTS = {
    "HELLO, another nonce": lambda b: b.request(Hello(VERSION_MAJOR, 0, NONCE + 1)),
    "HELLO, open nonce": lambda b: b.request(Hello(VERSION_MAJOR, 0, NONCE)),
    "ARM": lambda b: b.request(Arm()),
    "MUTE, any session": lambda b: b.request(Mute()),
    "DISARM": lambda b: b.request(Disarm()),
    "a fault of the hardware": lambda b: b.simulation.dialect.raise_hardware_fault(),
    "stream frame accepted": lambda b: b.frame(b.now_us + 2 * FAR_US - 1_000_000),
    "stream frame dropped": lambda b: b.frame(b.now_us - FAR_US),
    "SET_CONFIG": lambda b: b.request(SetConfig(OTHER)),
    "PLAY": lambda b: b.request(Play(1, SLOW_US, 0, 9000), flags=Flag.IMMEDIATE),
    "STOP of a playback": lambda b: b.request(Stop()),
    "UPLOAD_BEGIN": lambda b: b.request(UploadBegin(UploadKind.PHASES, 0, 3, N, 0)),
    "UPLOAD_CHUNK": lambda b: b.request(UploadChunk(N, bytes(7))),
    "UPLOAD_COMMIT": Bench.complete,
    "GET_STATUS": lambda b: b.request(GetStatus()),
    "STATUS sent": lambda b: b.run(1_000_000),
    "any other request, carried out": lambda b: b.request(Ping(1)),
    "request refused behind step 11": lambda b: b.request(GetGeometry(N, 1)),
    "request refused in steps 5 to 11": lambda b: b.request(Arm(), flags=0x40),
    "reset": Bench.reset,
    "frame of the open session, any": lambda b: b.send(StateChanged(0, 0), 0),
    "latch": lambda b: b.run(2),
    "end of a ramp": lambda b: b.run(2),
    "last frame of a playback, besides its latch": lambda b: b.run(2),
}
LATCHES = ("_latch_stream", "_latch_playback")
#: What goes before an input that time brings about.
BEFORE = {
    "latch": lambda b: b.run_up_to(*LATCHES),
    "end of a ramp": lambda b: (b.frame(b.now_us + 9_500_000), b.run_up_to("_time_out")),
    "last frame of a playback, besides its latch": lambda b: (
        b.play_twice(),
        b.run_up_to(*LATCHES),
    ),
}
#: Inputs that one of the two situations knows only.
STREAMING = {"stream frame accepted", "stream frame dropped", "PLAY"}
PLAYING = {"STOP of a playback", "last frame of a playback, besides its latch"}
#: It is a latch, too.
ALSO = {"last frame of a playback, besides its latch": {"hold", "last latch, ring", "divider"}}


def test_every_row_has_its_input():
    assert set(INPUTS) == set(EFFECTS)


@pytest.mark.parametrize("name", sorted(INPUTS))
def test_an_input_changes_what_its_row_says(name):
    changed = set()
    for plays in (False, True):
        if name in (PLAYING if not plays else STREAMING):
            continue
        bench = Bench(plays=plays)
        BEFORE.get(name, lambda _: None)(bench)
        before = bench.held()
        INPUTS[name](bench)
        after = bench.held()
        changed |= {held for held in WHERE if before[held] != after[held]}
    assert changed == EFFECTS[name] | ALSO.get(name, set())
