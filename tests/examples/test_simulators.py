"""docs/examples/simulators in the simulators themselves, where they are installed."""

import re
import shlex
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from board_differential import main as differential
from haptogram.cli import main as haptogram

pytestmark = pytest.mark.nightly

HERE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "simulators"
PAGE = HERE.parents[1] / "simulators.md"
PACKAGES = {"verilator": "verilator", "iverilog": "iverilog", "ghdl": "ghdl", "avr-gcc": "gcc-avr"}
DIALECT = ["--dialect", "sonicsurface"]
CIRCLE = ["--object", "circle", "--radius-mm", "5", "--center-mm", "0,0,60", "--quiet"]
VERIFY = ["verify", "--virtual-time", *DIALECT, *CIRCLE]
AVR = "atmega328p 20480000 25000 1000000 B"
ECHO = """
module board (input clk, input rx, output reg tx, output reg [15:0] pins);
    always @(posedge clk) tx <= rx;
endmodule
"""
ECHO_VHDL = """
library ieee; use ieee.std_logic_1164.all;
entity board is
    port (clk, rx : in std_logic; tx : out std_logic := '1';
          pins : out std_logic_vector(15 downto 0) := (others => '0'));
end entity;
architecture echo of board is begin tx <= rx when rising_edge(clk); end architecture;
"""


def need(*tools):
    for tool in tools:
        if shutil.which(tool) is None:
            pytest.skip(f"not run: {tool} is missing (Debian: {PACKAGES[tool]})")


def run(words, folder):
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def verilator(folder, board=HERE / "board.v", *parameters, defines=""):
    need("verilator")
    flags = "-O2 -DMODEL=Vboard -DCLK=clk -DRX=rx -DPINS=pins -DCOUNT=16 -DHZ=32000000"
    options = ["--cc", "--exe", "--build", "-O3", "--top-module", "board", "-Mdir", "obj"]
    words = ["verilator", *options, *parameters, "-CFLAGS"]
    words += [f"{flags} -DPERIOD=25000 -DSTART=0 {defines}", board, HERE / "verilator.cpp"]
    run(words, folder)
    return str(folder / "obj" / "Vboard")


def icarus(folder, board=HERE / "board.v", *defines):
    need("iverilog")
    names = "-DMODEL=board -DCLK=clk -DRX=rx -DPINS=pins -DCOUNT=16 -DPERIOD=25000 -DSTART=0"
    words = ["iverilog", "-g2005-sv", "-s", "simulator", *names.split(), *defines]
    run([*words, "-DHALF_CLOCK_PS=15625", "-o", "b.vvp", HERE / "icarus.v", board], folder)
    return f"vvp -n {folder}/b.vvp"


def ghdl(folder, board=HERE / "board.vhd", adapter=HERE / "ghdl.vhd"):
    need("ghdl")
    run(["ghdl", "-a", "--std=08", board, adapter], folder)
    run(["ghdl", "-e", "--std=08", "simulator"], folder)
    generics = "-gHALF_CLOCK_PS=15625 -gPERIOD_NS=25000 -gSTART_NS=0 -gCOUNT=16"
    return f"ghdl -r --std=08 --workdir={folder} simulator {generics}"


def simavr(folder):
    need("avr-gcc")
    if not Path("/usr/include/simavr").is_dir():
        pytest.skip("not run: simavr is missing (Debian: libsimavr-dev)")
    cpu = ["-O2", "-mmcu=atmega328p", "-DF_CPU=20480000"]
    run(["avr-gcc", *cpu, "-o", "board.elf", HERE / "board.c"], folder)
    run(["gcc", "-O2", "-Wall", "-o", "avr", HERE / "simavr.c", "-lsimavr"], folder)
    return f"{folder}/avr {AVR} {folder}/board.elf"


def verify(simulator, capsys, array="4x4", *others):
    words = [*VERIFY, "--array", array, "--resolution-mm", "8", *others, "--simulator", simulator]
    status = haptogram(words)
    return status, capsys.readouterr().out


def answers(simulator, lines):
    words = shlex.split(simulator)
    done = subprocess.run(words, input=lines, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.fixture(scope="module")
def right_board(tmp_path_factory):
    return verilator(tmp_path_factory.mktemp("right"))


def test_ten_frames_in_verilator_are_a_verdict_within_a_minute(right_board, capsys):
    begin_s = time.process_time()
    status, text = verify(right_board, capsys, "4x4", "--resolution-mm", "3")
    assert time.process_time() - begin_s < 60
    assert status == 0, text
    assert "10 sent, 10 latched, 10 verified" in text
    assert "evidence  simulated" in text


@pytest.mark.parametrize(
    ("defect", "seen"),
    [
        ("LATE_BIT=1", "element 15 (3, 3) off by +1 LSB"),
        ("STAGGER=7", "FAIL"),
        ("WRONG_BUFFER=1", "wrong drive"),
        ("HALF_CARRIER=1", "the whole array is silent"),
        ("TORN=40", "latched that nobody intended"),
    ],
)
def test_each_defect_of_the_board_fails(tmp_path, capsys, defect, seen):
    status, text = verify(verilator(tmp_path, HERE / "board.v", f"-G{defect}"), capsys)
    assert status == 1
    assert seen in text


def test_icarus_says_what_verilator_says(tmp_path, right_board):
    frame = "".join(f"B {40000 + 43403 * n} {n % 32:02x}\n" for n in range(20))
    lines = f"L 4340\nT 30000\nB 31000 fe\n{frame}B 1000000 fd\nT 1200000\n"
    said = [re.sub("by .*", "", answers(s, lines)) for s in (icarus(tmp_path), right_board)]
    assert said[0] == said[1]
    assert said[0].count("|") == 49


@pytest.mark.parametrize(("make", "array"), [(icarus, "4x4"), (ghdl, "4x4"), (simavr, "4x2")])
def test_the_other_simulators_come_to_a_verdict(tmp_path, monkeypatch, capsys, make, array):
    monkeypatch.chdir(tmp_path)
    status, text = verify(make(tmp_path), capsys, array)
    assert status == 0, text


def test_bytes_that_a_board_sends_come_back(tmp_path):
    (tmp_path / "echo.v").write_text(ECHO)
    (tmp_path / "echo.vhd").write_text(ECHO_VHDL)
    adapter = (HERE / "ghdl.vhd").read_text().replace("rx => rx,", "rx => rx, tx => tx,")
    (tmp_path / "adapter.vhd").write_text(adapter)
    lines = "L 4340\nT 10000\nB 20000 a5\nT 100000\nT 200000\n"
    for simulator in (
        verilator(tmp_path, tmp_path / "echo.v", defines="-DTX=tx"),
        icarus(tmp_path, tmp_path / "echo.v", "-DTX=tx"),
        ghdl(tmp_path, tmp_path / "echo.vhd", tmp_path / "adapter.vhd"),
    ):
        text = answers(simulator, lines).lower()
        (found,) = re.findall(r"^r (\d+) a5\n\. (\d+)$", text, re.MULTILINE)
        assert found[0] == found[1]
        assert 20_000 + 9 * 4_340 < int(found[0]) < 20_000 + 10 * 4_340


def test_the_emulation_and_the_board_agree_on_hostile_bytes(right_board, capsys):
    words = [*DIALECT, "--array", "4x4", "--simulator", right_board, "--examples", "100"]
    assert differential(words) == 0
    assert "the pins agree" in capsys.readouterr().out


@pytest.mark.parametrize("adapter", ["verilator.cpp", "icarus.v", "ghdl.vhd", "simavr.c"])
def test_each_adapter_is_short_and_on_the_page(adapter):
    lines = [line.strip() for line in (HERE / adapter).read_text("utf-8").splitlines()]
    code = [line for line in lines if line and not line.startswith(("//", "--"))]
    assert len(code) < 100
    assert adapter in PAGE.read_text("utf-8")
