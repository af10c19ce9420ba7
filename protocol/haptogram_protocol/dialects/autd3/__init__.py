"""AUTD3: the TCP link "Remote" of autd3 38 and the frames of 626 bytes that it carries.

The link (:mod:`.link`) opens and closes and moves frames; a frame (:mod:`.frame`) holds one or two
operations for one device (:mod:`.operations`). How a device obeys them belongs to the simulator.
"""
