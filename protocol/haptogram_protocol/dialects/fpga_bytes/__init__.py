"""The byte rules that the FPGAs of SonicSurface and Ultraino share: codes, and bytes that command.

A byte of :attr:`~.operations.FpgaByteRules.commands` is a command wherever it stands; every other
byte is the code of the next channel. There is no length and no checksum, so a lost byte shifts the
channels after it until the next start or swap, here as on the boards.

Source: upnalab/SonicSurface, ``Firmware/FPGA primary/src/Distribute.vhd`` and ``PhaseLine.vhd``,
0c7b689.
"""
