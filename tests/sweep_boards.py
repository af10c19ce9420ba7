"""Firmware that brings down what runs it."""

import os

from sim_device.board.clock import BoardClock


class Raises(BoardClock):
    """An error that is no verdict, and that no other process can be told of."""

    def __init__(self, *_, **__):
        class LocalError(Exception):
            pass

        raise LocalError("no such\nluck")


class EndsItsProcess(BoardClock):
    """A crash below Python."""

    def __init__(self, *_, **__):
        os._exit(9)
