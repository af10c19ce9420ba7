"""A virtual board and a host's connection, joined without a line that takes time."""

from haptogram_protocol import NEED_DATA, HostConnection
from haptogram_protocol.connection import ReplyReceived
from haptogram_protocol.messages import Arm, Config, SetConfig
from sim_device.board.settings import BoardSettings
from sim_device.simulation import Simulation

TURN_NS = 100_000  # for the board to answer


class BoardAtHand:
    """Both ends, and what the board has latched."""

    def __init__(self, cobs):
        self.latches = []
        self.simulation = Simulation(BoardSettings(), self, paced=False)
        self.host = HostConnection(nonce=1, cobs=cobs)

    def latch(self, latch):
        self.latches.append(latch)

    def notice(self, notice):
        pass

    def armed(self):
        """Open the session and arm the board."""
        self.host.send_hello(self.now_us)
        self.exchange()
        self.ask(SetConfig(Config(status_period_ms=0)))
        self.ask(Arm())
        return self

    @property
    def now_us(self):
        return self.simulation.now_ns // 1000

    def ask(self, message):
        self.host.send_request(message, self.now_us)
        (answer,) = self.exchange()
        assert isinstance(answer, ReplyReceived), answer
        return answer.message

    def exchange(self):
        """Carry what waits to the board, and its answer back."""
        simulation, host = self.simulation, self.host
        simulation.host_write(host.data_to_send(), simulation.now_ns)
        simulation.advance_to(simulation.now_ns + TURN_NS)
        host.receive_data(simulation.host_read(), self.now_us)
        events = []
        while (event := host.next_event()) is not NEED_DATA:
            events.append(event)
        return events

    def show(self, message):
        """Stream a frame and let the board latch it; return the latch."""
        simulation = self.simulation
        self.latches.clear()
        _, wire = self.host.stream_frame(message, t_apply_us=None)
        simulation.host_write(wire, simulation.now_ns)
        simulation.advance_to(simulation.now_ns + TURN_NS)
        return self.latches[-1]
