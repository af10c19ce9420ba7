"""A virtual board behind a pty that is deaf for a while after it has named its port.

python deaf_board.py LINK SECONDS [OPTION OF sim_device ...]
"""

import os
import pty
import select
import subprocess
import sys
import time
import tty


def relay(host, board):
    """Pass everything on, both ways, until the board ends."""
    while True:
        ready, _, _ = select.select([host, board], [], [])
        for one, other in ((host, board), (board, host)):
            if one in ready:
                os.write(other, os.read(one, 65_536))


def main(link, deaf_s, *options):
    """Name a pty, lose what comes while the board starts and *deaf_s* longer, then relay."""
    host, port = pty.openpty()
    tty.setraw(port)
    sys.stdout.write(f"listening on {os.ttyname(port)}\n")
    sys.stdout.flush()
    command = [sys.executable, "-m", "sim_device", "--link", link, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        process.stdout.readline()  # the board is there
        board = os.open(link, os.O_RDWR | os.O_NOCTTY)
        end_s = time.monotonic() + float(deaf_s)
        while (left_s := end_s - time.monotonic()) > 0:
            if select.select([host], [], [], left_s)[0]:
                os.read(host, 65_536)
        relay(host, board)


if __name__ == "__main__":
    main(*sys.argv[1:])
