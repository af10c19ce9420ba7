"""The wires of existing boards: their bytes as operations, and operations as their bytes.

Here are codecs only. What a board does with the operations belongs to the simulator, and
Haptogram's own wire to the rest of this package. :mod:`.codec` says what a dialect is,
:mod:`.table` lists all, :mod:`.looks_like` guesses one from bytes.
"""
