"""Meanings of the exit statuses of all commands."""

from __future__ import annotations

from typing import Final

PASS: Final = 0
FAIL: Final = 1
USAGE: Final = 2
INCONCLUSIVE: Final = 3
INTERRUPTED: Final = 130  # as every shell has it

#: Exit status of every command, in the help that lists them.
EVERY_STATUS: Final = """\
exit status, of every command:
  0    done; a command that judges found nothing wrong
  1    a check of the command failed, or the virtual board lost its port
  2    usage or environment error: nothing was judged, or a result could not be written
  3    inconclusive: too little could be observed for a verdict
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP) before there was a verdict; the virtual board ends
       with 0 then
"""
#: Exit status of ``haptogram verify``.
EXIT_STATUS: Final = """\
exit status:
  0  pass: enough frames were verified and none was wrong
  1  fail: a focus off target, a wrong drive, or a damaged frame that was latched
  2  usage or environment error: nothing was judged, or a result could not be written
  3  inconclusive: too few frames could be verified, the link was lost, or planned faults broke it
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP), and nothing was wrong in what was seen until then
"""
