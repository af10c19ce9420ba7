"""The command line, and the composition root: the only room that may import the virtual board."""

from .program import COMMANDS, command_parser, main

__all__ = ["COMMANDS", "command_parser", "main"]
