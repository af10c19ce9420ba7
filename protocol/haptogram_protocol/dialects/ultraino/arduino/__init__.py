"""Ultraino's Arduino boards: MEGA64 with the usual and the animation firmware, Nano16 and Nano8.

A byte of a pattern holds four bits of it in its high nibble; its low nibble counts the boards of
the chain down to 1, and the board that finds 1 keeps it. All else goes on to the next board; what
the last one sends comes back to the host, which ignores it. 115 200 baud, 8N1.

====================  ============================================================================
00                    swap the buffers, write slot 0 next; sent on
hhhhnnnn, n = 1       half a slot byte: high half first
hhhhnnnn, n >= 2      sent on as byte - 1
dd110000              MEGA64: two bits of a duration, high ones first; sent on
10                    MEGA64: take the durations; Nano16: write slot 0 next; sent on
any other             sent on as byte - 1
====================  ============================================================================

A pattern of MEGA64 is 10 slots of 10 port bytes, 200 bytes on the wire; with the durations 1 and 0,
10h and 00h the frame has 210 bytes, that of 4 boards 810. Source: asiermarzo/Ultraino,
``DriverBoards/ArduinoMega64/firmware/DriverMEGA/DriverMEGA.ino`` 3ad4bdf,
``DriverMEGAAnim/DriverMEGAAnim.ino`` and ``DriverBoards/DriverNano16/DriverNano16.ino`` 6411b27;
clients: ``protocols/ArduinoMEGA64.java`` and others, 3d5a02a.
``DriverMEGAStatic.ino`` takes the same bytes, but has room for 8 patterns and 8 durations only; it
has no dialect here.

Not known: what MEGA64 and Nano16 do after the end of their memory (32 patterns, 32 durations, one
pattern), where the firmware writes on without a check (nothing is taken here); the firmware of
Nano8 (as Nano16's here, with 24 slots of one port).
"""
