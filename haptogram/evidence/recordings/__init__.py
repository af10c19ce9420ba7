"""Recordings of a run in MCAP: bytes in both directions, latches, and what was made of them.

:mod:`.channels` is the table of the format;
:mod:`.writer` writes while a run goes on, :mod:`.tap` listens at a port for it, :mod:`.reader`
reads, and :mod:`.replay` compares what another board does with the same bytes.  Nothing here judges
a frame.
"""
