"""Devices of AUTD3: segments, sequences, modulation, and the pulses that come of them.

The codec of the link is :mod:`haptogram_protocol.dialects.autd3`. Here is the work of a device's
processor (:mod:`.device`, :mod:`.memory`, :mod:`.refusals`), that of its FPGA (:mod:`.segments`,
:mod:`.foci`), and the pulses and the clock of all devices (:mod:`.unit`).
"""
