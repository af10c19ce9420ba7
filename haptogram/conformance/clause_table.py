"""Every clause of SPEC.md: its number and its text.

Written by ``python -m haptogram.conformance.clauses protocol/SPEC.md``; not edited by hand.
"""

from __future__ import annotations

from typing import Final

TABLE: Final = (
    (
        "HG-1.2/1",
        "A board MUST meet every MUST of this text that does not name a capability, and those "
        "that name a capability which it advertises (HG-4.5).",
    ),
    (
        "HG-1.2/2",
        "A board MUST answer a request that needs a capability which it does not advertise "
        "with ERROR(UNSUPPORTED), detail: the type of the request.",
    ),
    (
        "HG-1.2/3",
        "A board MUST drop a stream frame that needs a capability which it does not advertise "
        "and count it in `unsupported`.",
    ),
    (
        "HG-2.1/1",
        "A sender MUST send a zero byte before and after every frame.",
    ),
    (
        "HG-2.1/2",
        "A receiver MUST accept a single zero byte between two frames as the end of one and "
        "the beginning of the other.",
    ),
    (
        "HG-2.1/3",
        "A receiver MUST accept every undamaged frame that has both of its delimiters, "
        "whatever came before the first of them.",
    ),
    (
        "HG-2.2/1",
        "Between the delimiters there MUST be the COBS encoding of body and CRC, which holds "
        "no zero.",
    ),
    (
        "HG-2.2/2",
        "A receiver MUST drop a frame in which a code byte points past the end and count it "
        "in `cobs`.",
    ),
    (
        "HG-2.2/3",
        "A receiver MUST accept a code byte `01` behind a full piece at the end of the data: "
        "some encoders add it, and it stands for nothing.",
    ),
    (
        "HG-2.3/1",
        "A receiver MUST ignore nothing between two delimiters: it is no frame and no error, "
        "and no counter counts it.",
    ),
    (
        "HG-2.4/1",
        "The last 4 bytes before stuffing MUST be the CRC-32/ISO-HDLC of the body, "
        "little-endian. (Polynomial 0x04C11DB7, reflected 0xEDB88320; initial value and final "
        "XOR 0xFFFFFFFF; of the nine ASCII bytes `123456789` it is 0xCBF43926. The same as in "
        "zlib, Ethernet and PNG.)",
    ),
    (
        "HG-2.4/2",
        "A receiver MUST drop a frame whose CRC is wrong, count it in `crc`, and take nothing "
        "from it: no sequence number, no lease, no answer.",
    ),
    (
        "HG-2.5/1",
        "A receiver MUST drop a frame that holds fewer than 14 bytes after unstuffing (10 of "
        "header, 4 of CRC) and count it in `short`.",
    ),
    (
        "HG-2.6/1",
        "A sender MUST NOT send more than 4096 bytes between two delimiters.",
    ),
    (
        "HG-2.6/2",
        "A receiver MUST take up to 4096 bytes between two delimiters, whatever the size of "
        "its array.",
    ),
    (
        "HG-2.6/3",
        "A receiver MUST discard a longer run up to the next zero byte and count it in "
        "`oversize`, once.",
    ),
    (
        "HG-2.7/1",
        "The line MUST carry every byte unchanged: 8 data bits, no parity, 1 stop bit where "
        "it is a UART; no flow control by characters, no line discipline.",
    ),
    (
        "HG-2.7/2",
        "A board MUST keep taking bytes at the full rate of the line, as long as no more than "
        "`rx_window` encoded bytes of requests and stream frames are unprocessed.",
    ),
    (
        "HG-2.7/3",
        "A board SHOULD send nothing before the first HELLO.",
    ),
    (
        "HG-3.1/1",
        "Every body MUST begin with this header.",
    ),
    (
        "HG-3.2/1",
        "Integers MUST be little-endian, signed ones in two's complement, without padding "
        "between fields.",
    ),
    (
        "HG-3.2/2",
        "Text MUST be UTF-8, filled with zero bytes to the size of its field.",
    ),
    (
        "HG-3.2/3",
        "A payload MUST have the length that its type calls for; nothing may follow the last "
        "field.",
    ),
    (
        "HG-3.2/4",
        "A receiver MUST drop a frame with a wrong length and count it in `bad_length`; a "
        "board answers a request with ERROR(BAD_LENGTH), detail: the length that the type "
        "calls for, 0 if it varies.",
    ),
    (
        "HG-3.2/5",
        "A receiver MUST drop a frame with a value outside the range that its field's table "
        "or clause gives and count it in `bad_value`; a board answers a request with "
        "ERROR(BAD_VALUE), detail: offset of the field in the payload.",
    ),
    (
        "HG-3.3/1",
        "A response MUST have the type of its request + 0x40, or be ERROR.",
    ),
    (
        "HG-3.3/2",
        "A board MUST drop a stream frame of a type that it does not know, and any response "
        "or event type, and count it in `unknown_type`, never as damage.",
    ),
    (
        "HG-3.3/3",
        "A board MUST answer a request of a type that it does not know with "
        "ERROR(UNSUPPORTED), detail: the type, and count it in `unsupported`.",
    ),
    (
        "HG-3.3/4",
        "A host MUST ignore a response or event of a type that it does not know.",
    ),
    (
        "HG-3.4/1",
        "A receiver MUST drop a frame with a set bit in the high nibble that it does not "
        "know, or that has no meaning in a frame of this type, and count it in `unsupported`; "
        "a board answers a request with ERROR(UNSUPPORTED), detail: these bits.",
    ),
    (
        "HG-3.4/2",
        "A receiver MUST ignore bits in the low nibble that it does not know.",
    ),
    (
        "HG-3.4/3",
        "A sender MUST leave bits clear that have no meaning in a frame of this type.",
    ),
    (
        "HG-3.5/1",
        "A board MUST take `IMMEDIATE` in stream frames and in PLAY, and in nothing else.",
    ),
    (
        "HG-3.5/2",
        "With `IMMEDIATE` a board MUST NOT look at `time_us`.",
    ),
    (
        "HG-3.6/1",
        "Every comparison of sequence numbers or times MUST be by signed difference.",
    ),
    (
        "HG-3.6/2",
        "Stream frames, requests and events MUST have three separate sequences, each going up "
        "by 1 from frame to frame.",
    ),
    (
        "HG-3.6/3",
        "The first stream frame of a session MUST have the sequence number 0xFFF0, so that "
        "every run crosses the wrap.",
    ),
    (
        "HG-3.6/4",
        "The first event of a session MUST have the sequence number 0.",
    ),
    (
        "HG-3.6/5",
        "Unwrapped, the first stream frame of a session has the number 65520; a board MUST "
        "report unwrapped numbers (TRACE, STATUS, read-back) counted from there, modulo 2^32.",
    ),
    (
        "HG-3.7/1",
        "Every frame MUST carry the nonce of its session, except that HELLO carries 0, MUTE "
        "carries 0 where its sender has no session, and ERROR carries 0 as said in HG-4.12.",
    ),
    (
        "HG-3.7/2",
        "A board MUST drop a stream frame that is not of the open session and count it in "
        "`stale_session`.",
    ),
    (
        "HG-3.7/3",
        "A host MUST ignore an event that is not of its session, and a response that is not, "
        "except to HELLO and MUTE, and except ERROR with session 0.",
    ),
    (
        "HG-3.8/1",
        "A board MUST judge frames in this order.",
    ),
    (
        "HG-3.8/2",
        "A board MUST process frames in the order of their arrival: a HELLO opens the session "
        "for the frame behind it.",
    ),
    (
        "HG-3.8/3",
        "MUTE MUST pass from step 5 to its execution: neither session, flags, payload nor "
        "sequence number refuses it.",
    ),
    (
        "HG-3.9/1",
        "A board MUST count every dropped frame exactly once.",
    ),
    (
        "HG-3.9/2",
        "A board MUST count every frame whose CRC is right in `frames`, and so `frames` = "
        "stream frames queued + `requests` + `repeated` + `duplicate` + `stale_session` + "
        "`bad_length` + `bad_value` + `unknown_type` + `unsupported` + `dropped_state` + "
        "`dropped_order` + `dropped_full` + `dropped_future` + `dropped_late`.",
    ),
    (
        "HG-3.9/3",
        "A board MUST NOT hang, restart, or change its output because of bytes that are no "
        "valid frame.",
    ),
    (
        "HG-3.9/4",
        "Bytes that are no valid frame MUST NOT use anything up: after megabytes of them a "
        "board MUST answer as before and report the same `free_bytes`.",
    ),
    (
        "HG-4.1/1",
        "A host MUST open a session with HELLO before it sends anything but MUTE.",
    ),
    (
        "HG-4.1/2",
        "A host MUST choose the nonce at random, from 1 to 65535, for every session.",
    ),
    (
        "HG-4.1/3",
        "A board MUST refuse the nonce 0 with ERROR(BAD_VALUE), detail 2.",
    ),
    (
        "HG-4.1/4",
        "A board MUST have at most one open session: the one of the last HELLO that it "
        "accepted. After a reset none is open.",
    ),
    (
        "HG-4.2/1",
        "Each end MUST state its own version in HELLO and HELLO_REPLY.",
    ),
    (
        "HG-4.3/1",
        "A board MUST accept HELLO in every output state, and answer with HELLO_REPLY.",
    ),
    (
        "HG-4.3/2",
        "`carrier_hz` MUST divide 1 000 000, so that the carrier period is a whole number of "
        "microseconds.",
    ),
    (
        "HG-4.3/3",
        "`clock_hz` MUST be 1 000 000.",
    ),
    (
        "HG-4.3/4",
        "`grid_nx` and `grid_ny` MUST have N as their product, or both be 0.",
    ),
    (
        "HG-4.3/5",
        "`boot_id` SHOULD differ after every reset.",
    ),
    (
        "HG-4.3/6",
        "`geometry_hash` MUST be the CRC-32 of the N records of 18 bytes that GET_GEOMETRY "
        "shows, in order.",
    ),
    (
        "HG-4.4/1",
        "A board MUST answer a HELLO of another major version with ERROR(VERSION), detail: "
        "its own major version, and change nothing.",
    ),
    (
        "HG-4.4/2",
        "A host MUST NOT go on with a board of another major version.",
    ),
    (
        "HG-4.5/1",
        "A host MUST NOT use what the board does not advertise.",
    ),
    (
        "HG-4.5/2",
        "A host MUST ignore capability bits that it does not know.",
    ),
    (
        "HG-4.6/1",
        "A HELLO with the nonce of the open session MUST have no effect but the same "
        "HELLO_REPLY again, the `state` field as it was the first time. It is counted in "
        "`repeated`.",
    ),
    (
        "HG-4.6/2",
        "A HELLO with another nonce MUST move the output state as the table in HG-6.2 says, "
        "with the output off as in HG-6.6.",
    ),
    (
        "HG-4.6/3",
        "A HELLO with another nonce MUST flush the queue, end playback, and abandon an upload "
        "that is not committed.",
    ),
    (
        "HG-4.6/4",
        "A HELLO with another nonce MUST start the sequences of stream frames, requests and "
        "events anew, forget the remembered reply and empty the trace ring.",
    ),
    (
        "HG-4.6/5",
        "A HELLO with another nonce MUST leave stored sequences, configuration, phase "
        "correction and counters as they are.",
    ),
    (
        "HG-4.6/6",
        "A HELLO with another nonce MUST be accepted whatever its sequence number, which is "
        "then the newest one of the session: the next request has to be ahead of it "
        "(HG-4.9/3).",
    ),
    (
        "HG-4.7/1",
        "A board MUST NOT send an event while no session is open.",
    ),
    (
        "HG-4.8/1",
        "A host MUST NOT send a request before the one before it is answered or given up, "
        "except MUTE and, within the window, UPLOAD_CHUNK.",
    ),
    (
        "HG-4.8/2",
        "A host MUST send a request again, byte for byte, when its retransmission timeout "
        "(HG-12.6) has passed.",
    ),
    (
        "HG-4.8/3",
        "A host MUST give every new request a sequence number that is one higher, HELLO and "
        "MUTE included.",
    ),
    (
        "HG-4.8/4",
        "The first request of a host SHOULD have the sequence number 0; HG-4.8/3 holds across "
        "sessions, so that a later HELLO has any number.",
    ),
    (
        "HG-4.9/1",
        "A board MUST answer a request with the sequence number and the CRC of the remembered "
        "one by the same bytes again, do nothing, and count it in `repeated`.",
    ),
    (
        "HG-4.9/2",
        "A board MUST refuse a request with the sequence number of the remembered one and "
        "another CRC with ERROR(SEQUENCE_REUSED), detail: the sequence number.",
    ),
    (
        "HG-4.9/3",
        "A board MUST likewise refuse a request whose sequence number is not ahead of the "
        "newest one of the session: a delayed copy of ARM must not undo a later DISARM.",
    ),
    (
        "HG-4.9/4",
        "A refusal in steps 5 to 11 of HG-3.8 MUST NOT be remembered and MUST NOT use up a "
        "sequence number.",
    ),
    (
        "HG-4.10/1",
        "A board MUST carry out MUTE and UPLOAD_CHUNK every time, without comparing them with "
        "the remembered request and without remembering them. Their sequence numbers count as "
        "used (HG-4.9/3) if they are of the open session.",
    ),
    (
        "HG-4.11/1",
        "A response MUST have the sequence number of its request, and the open session (0 if "
        "there is none).",
    ),
    (
        "HG-4.11/2",
        "A response MUST carry the device time of its first byte.",
    ),
    (
        "HG-4.11/3",
        "A board SHOULD begin its response within 10 ms of the request's arrival, the uplink "
        "permitting.",
    ),
    (
        "HG-4.11/4",
        "A host MUST ignore a response that answers no request which waits.",
    ),
    (
        "HG-4.11/5",
        "A response MUST leave before the events that carrying out its request leads to; of "
        "those STATE_CHANGED MUST leave before PLAYBACK_ENDED.",
    ),
    (
        "HG-4.12/1",
        "A board MUST refuse a request that is neither HELLO nor MUTE and not of the open "
        "session with ERROR(STALE_SESSION), session 0, detail: the open session, 0 if there "
        "is none. It is counted in `stale_session`.",
    ),
    (
        "HG-5.1/1",
        "N MUST be 1 to 1024.",
    ),
    (
        "HG-5.2/1",
        "Codes MUST be packed without gaps: code n takes the bits n b to n b + b - 1 of the "
        "payload behind `bank`, bit 0 being the lowest bit of the first byte.",
    ),
    (
        "HG-5.2/2",
        "Spare bits of the last byte MUST be 0 (`bad_value`).",
    ),
    (
        "HG-5.2/3",
        "A payload MUST hold ceil(N b / 8) bytes of codes (`bad_length`).",
    ),
    (
        "HG-5.2/4",
        "`bank` MUST be 0 in this version (`bad_value`).",
    ),
    (
        "HG-5.2/5",
        "A board MUST accept the formats that it advertises in `phase_formats` and drop the "
        "others (`bad_value`).",
    ),
    (
        "HG-5.2/6",
        "A board MUST take every amplitude of a PHASES frame as 255.",
    ),
    (
        "HG-5.2/7",
        "The registers of a board have 8 bits: a code of 6 bits MUST be latched as 4 c, of 5 "
        "bits as 8 c. Trace and read-back show the registers.",
    ),
    (
        "HG-5.3/1",
        "A board with `AMPLITUDE` MUST accept DRIVES; `bits` is 8 (`bad_value`), and there "
        "are 2 N bytes of codes (`bad_length`).",
    ),
    (
        "HG-5.3/2",
        "The amplitude of the pressure MUST be proportional to the amplitude code, 255 being full.",
    ),
    (
        "HG-5.4/1",
        "A board with `POINTS` MUST latch the phase code floor(arg(w_n) / (2 pi) * 256 + 1/2) "
        "modulo 256.",
    ),
    (
        "HG-5.4/2",
        "A board with `POINTS` and `AMPLITUDE` MUST latch the amplitude code floor(255 min(1, "
        "|w_n|) + 1/2), and without `AMPLITUDE` 255.",
    ),
    (
        "HG-5.4/3",
        "An error of the board's arithmetic MUST NOT exceed one step of a phase code or of an "
        "amplitude code.",
    ),
    (
        "HG-5.4/4",
        "A frame MUST hold 1 to `max_points` points (more: `bad_value`).",
    ),
    (
        "HG-5.5/1",
        "If d is negative the board MUST drop the frame and count it in `duplicate`.",
    ),
    (
        "HG-5.5/2",
        "If d is positive the board MUST add d to `gap` and go on with the frame.",
    ),
    (
        "HG-5.6/1",
        "A stream frame of the open session MUST use up its sequence number even if it is "
        "dropped at step 5 or at any step after 7 of HG-3.8.",
    ),
    (
        "HG-5.7/1",
        "A board MUST drop a stream frame while it is not ARMED or while a sequence plays "
        "(`dropped_state`).",
    ),
    (
        "HG-5.7/2",
        "A board MUST drop a frame whose `t_apply` is not after that of the last frame in the "
        "queue (`dropped_order`).",
    ),
    (
        "HG-5.7/3",
        "A board MUST drop a frame that meets `queue_depth` frames in the queue "
        "(`dropped_full`); the queued ones stay.",
    ),
    (
        "HG-5.7/4",
        "A board MUST drop a frame whose `t_apply` is more than `max_horizon_us` ahead "
        "(`dropped_future`).",
    ),
    (
        "HG-5.7/5",
        "A board MUST drop a frame whose lateness exceeds `late_window_us` (`dropped_late`).",
    ),
    (
        "HG-5.7/6",
        "A board MUST latch a frame whose lateness does not exceed `late_window_us`, count it "
        "in `late` when it is latched, and set `LATE` in its trace.",
    ),
    (
        "HG-5.7/7",
        "`max_horizon_us` MUST be less than 2^31.",
    ),
    (
        "HG-5.8/1",
        "A board MUST latch a frame at the first multiple of the carrier period, of the "
        "unwrapped device clock (HG-6.9), that is neither before its `t_apply` nor before its "
        "arrival.",
    ),
    (
        "HG-5.8/2",
        "A latch MUST change all transducers within the same carrier period: no period mixes "
        "two drives.",
    ),
    (
        "HG-5.8/3",
        "A board MUST latch at most one drive in a carrier period: of two queued frames that "
        "fall on the same one, the later replaces the earlier, which is counted in `flushed`.",
    ),
    (
        "HG-5.8/4",
        "A board MUST count every latch in `latched`.",
    ),
    (
        "HG-5.8/5",
        "The last latched drive MUST stay until the next latch or until the output goes off "
        "(chapter 6).",
    ),
    (
        "HG-5.9/1",
        "A frame with `IMMEDIATE` MUST flush the queue (`flushed`) and be latched at the "
        "first carrier period at or after its arrival.",
    ),
    (
        "HG-6.1/1",
        "After a reset the state MUST be DISARMED, and no transducer may be driven.",
    ),
    (
        "HG-6.2/1",
        "A board MUST follow this table.",
    ),
    (
        "HG-6.2/2",
        "ERROR(BAD_STATE) MUST have the output state as its detail.",
    ),
    (
        "HG-6.2/3",
        "The `reason` MUST become that of the input when the state changes (NONE for ARM); an "
        "input that leaves the state as it is MUST leave the reason too, but for MUTE "
        "(HG-6.4/4).",
    ),
    (
        "HG-6.3/1",
        "After ARM the output MUST stay silent until the first latch.",
    ),
    (
        "HG-6.3/2",
        "ARM while ARMED MUST change nothing but renew the lease.",
    ),
    (
        "HG-6.4/1",
        "A board MUST carry out MUTE in every state, from any session or none, whatever its "
        "flags, payload and sequence number.",
    ),
    (
        "HG-6.4/2",
        "MUTE MUST flush the queue (`flushed`) and end playback.",
    ),
    (
        "HG-6.4/3",
        "A host MUST be able to get MUTE onto the line at once: it MUST NOT have more than "
        "two stream frames written but unsent.",
    ),
    (
        "HG-6.4/4",
        "MUTE while MUTED MUST make the `reason` MUTE, whatever it was: somebody asked for "
        "silence now, and no host may take it for a pause of its stream.",
    ),
    (
        "HG-6.5/1",
        "DISARM MUST flush the queue (`flushed`) and end playback.",
    ),
    (
        "HG-6.5/2",
        "DISARM while MUTED MUST leave the state MUTED.",
    ),
    (
        "HG-6.6/1",
        "The radiated amplitude of every transducer MUST be 0 no later than one carrier "
        "period after the arrival of MUTE, DISARM or a HELLO with another nonce, and one "
        "carrier period after a fault is found.",
    ),
    (
        "HG-6.6/2",
        "In DISARMED, MUTED and FAULT the radiated amplitude MUST be 0.",
    ),
    (
        "HG-6.6/3",
        "In FAULT a board SHOULD refuse DISARM with ERROR(FAULT) as long as the fault lasts.",
    ),
    (
        "HG-6.7/1",
        "Every frame whose CRC is right and whose session is the open one MUST renew the "
        "lease (HG-12.2), whatever else becomes of it.",
    ),
    (
        "HG-6.8/1",
        "A board MUST send STATE_CHANGED when a timer or a fault changes the output state.",
    ),
    (
        "HG-6.8/2",
        "A board SHOULD send STATE_CHANGED when a MUTE that is not of the open session "
        "changes the output state.",
    ),
    (
        "HG-6.9/1",
        "The device clock MUST NOT step, and its rate MUST be within `clock_ppm` of the true one.",
    ),
    (
        "HG-6.9/2",
        "`t_rx_us` MUST be the arrival of the PING, `t_tx_us` the time at which the first "
        "byte of the PONG leaves, each within 10 us.",
    ),
    (
        "HG-6.9/3",
        "A host SHOULD subtract the time that the bytes take on the line, and MUST NOT claim "
        "a clock error below half of the shortest round trip seen.",
    ),
    (
        "HG-6.10/1",
        "If nothing is latched for `hold_ms` a sounding board MUST begin a ramp (HG-12.3).",
    ),
    (
        "HG-6.11/1",
        "During a ramp the radiated amplitude MUST NOT rise.",
    ),
    (
        "HG-6.11/2",
        "A ramp MUST reach 0 `ramp_ms` after it began, in steps of at most 1 ms or of at most "
        "1/8 of the amplitude at its beginning.",
    ),
    (
        "HG-6.11/3",
        "With `ramp_ms` = 0, or without `AMPLITUDE`, the output MUST go off within one "
        "carrier period of the timer's end.",
    ),
    (
        "HG-6.11/4",
        "What renews the timer that began a ramp MUST end the ramp at full amplitude: a latch "
        "that of the hold, a valid frame of the session that of the lease.",
    ),
    (
        "HG-6.11/5",
        "At the end of a ramp the state MUST become MUTED with the reason of the timer, the "
        "queue be flushed, playback end, and `timeouts` count it.",
    ),
    (
        "HG-7.1/1",
        "A board MUST refuse a value outside these bounds with ERROR(BAD_VALUE) and keep the "
        "whole old configuration.",
    ),
    (
        "HG-7.1/2",
        "A board MUST refuse a `status_period_ms` at which STATUS would take more than a "
        "tenth of the line with ERROR(BAD_VALUE).",
    ),
    (
        "HG-7.1/3",
        "A board with `CONFIG` MUST put a new configuration in force before it answers; a "
        "ramp that has begun goes on as it began.",
    ),
    (
        "HG-7.1/4",
        "After a reset the configuration MUST be the board's default, unless the board "
        "advertises `CONFIG_KEPT`.",
    ),
    (
        "HG-7.1/5",
        "`config_crc` MUST be the CRC-32 of the 20 bytes of the configuration and the N bytes "
        "of the phase correction (0 where there is none).",
    ),
    (
        "HG-7.1/6",
        "A `trace_mode` that the board does not advertise MUST be refused with ERROR(BAD_VALUE).",
    ),
    (
        "HG-7.2/1",
        "A board MUST refuse what it has no room for with ERROR(TOO_LARGE), detail: the limit "
        "(bytes, or frames), before the first byte is sent.",
    ),
    (
        "HG-7.2/2",
        "A board MUST refuse a size that is 0 or not a multiple of the frame with "
        "ERROR(BAD_LENGTH), detail: the bytes in a frame.",
    ),
    (
        "HG-7.2/3",
        "The `target` of a sequence is 1 to 65535, that of the phase correction 0; another "
        "one MUST be refused with ERROR(BAD_VALUE).",
    ),
    (
        "HG-7.2/4",
        "UPLOAD_BEGIN MUST abandon an upload that is not committed.",
    ),
    (
        "HG-7.2/5",
        "An upload for the sequence that is playing MUST be refused with ERROR(BAD_STATE).",
    ),
    (
        "HG-7.3/1",
        "A board MUST take chunks in any order, and the same one any number of times.",
    ),
    (
        "HG-7.3/2",
        "A board MUST take `window` chunks that arrive without a pause.",
    ),
    (
        "HG-7.3/3",
        "A chunk longer than `max_chunk` MUST be refused with ERROR(BAD_LENGTH), detail: the "
        "limit.",
    ),
    (
        "HG-7.3/4",
        "A chunk that ends past the announced size MUST be refused with ERROR(BAD_VALUE), and "
        "one without an upload with ERROR(BAD_STATE).",
    ),
    (
        "HG-7.4/1",
        "Until the commit the old sequence or correction MUST stay in force.",
    ),
    (
        "HG-7.4/2",
        "A commit with bytes missing MUST be refused with ERROR(INCOMPLETE), detail: the "
        "first missing byte; chunks may follow.",
    ),
    (
        "HG-7.4/3",
        "A commit of bytes whose CRC-32 is not the announced one MUST be refused with "
        "ERROR(CRC_MISMATCH), detail: the CRC-32 of what came.",
    ),
    (
        "HG-7.4/4",
        "A commit with another `target` than the upload MUST be refused with "
        "ERROR(BAD_VALUE), and one without an upload with ERROR(BAD_STATE).",
    ),
    (
        "HG-7.5/1",
        "A board MUST answer with the transducers from `first` on: `count` of them, or as "
        "many as there are, or as many as fit into one frame.",
    ),
    (
        "HG-7.5/2",
        "A board MUST answer `first` >= N with ERROR(NOT_FOUND), detail: N.",
    ),
    (
        "HG-7.6/1",
        "PLAY MUST be refused with ERROR(BAD_STATE) while the board is not ARMED or while a "
        "sequence plays, and with ERROR(NOT_FOUND), detail: number of stored sequences, if "
        "there is no such sequence.",
    ),
    (
        "HG-7.6/2",
        "A period below 1 000 000 / `max_playback_rate_hz` us, an `unattended_ms` of 0 or "
        "above `max_unattended_ms`, and a start that has passed or lies beyond "
        "`max_horizon_us` MUST be refused with ERROR(BAD_VALUE); for the start, which is in "
        "the header, the detail is 0.",
    ),
    (
        "HG-7.6/3",
        "PLAY MUST flush the queue (`flushed`).",
    ),
    (
        "HG-7.6/4",
        "Each frame MUST be latched at the first carrier period at or after the time at which "
        "it is due; times are never accumulated.",
    ),
    (
        "HG-7.6/5",
        "While a sequence plays, `unattended_ms` MUST stand for `host_timeout_ms` (HG-12.4).",
    ),
    (
        "HG-7.6/6",
        "With `loops` = 0 the sequence MUST play until STOP, MUTE, DISARM, a new session or a "
        "timer ends it.",
    ),
    (
        "HG-7.7/1",
        "STOP MUST end playback; the last drive is held as after any latch (HG-6.10).",
    ),
    (
        "HG-7.7/2",
        "STOP without a playback MUST be answered with STOP_REPLY.",
    ),
    (
        "HG-7.8/1",
        "A board MUST send PLAYBACK_ENDED when a playback ends, whatever ended it.",
    ),
    (
        "HG-7.8/2",
        "After the last frame the board stays ARMED, and stream frames MUST be taken again.",
    ),
    (
        "HG-7.9/1",
        "The correction codes MUST be added to the phase codes modulo 256 when they are "
        "radiated; the latched drive does not change.",
    ),
    (
        "HG-7.9/2",
        "The radiated amplitude code MUST NOT exceed `amplitude_ceiling`; the latched drive "
        "does not change.",
    ),
    (
        "HG-8.1/1",
        "A board MUST report latches as `trace_mode` says.",
    ),
    (
        "HG-8.2/1",
        "With the session this key MUST be unique: no two latches of a session have the same "
        "key, unless the same sequence is played again.",
    ),
    (
        "HG-8.3/1",
        "A trace event MUST carry the device time of the latch in its header.",
    ),
    (
        "HG-8.3/2",
        "The CRC MUST be the CRC-32 of N phase codes and N amplitude codes in registers of 8 "
        "bits, before correction, ceiling and ramp.",
    ),
    (
        "HG-8.4/1",
        "In mode DRIVE a board MUST report every `trace_divider`-th latch, beginning with the "
        "first one after HELLO or SET_CONFIG, and nothing of the others.",
    ),
    (
        "HG-8.5/1",
        "In mode RING a board MUST keep the last `trace_ring` latches of the session; latches "
        "are numbered from 0 in every session.",
    ),
    (
        "HG-8.5/2",
        "READ_TRACE MUST be answered with those of the latches `first` to `first` + `count` - "
        "1 that the ring holds, oldest first, as many as fit into one frame; none is no "
        "error.",
    ),
    (
        "HG-8.6/1",
        "A board MUST answer with the transducers from `first` on: `count` of them, or as "
        "many as there are, or as many as fit into one frame.",
    ),
    (
        "HG-8.6/2",
        "A board MUST answer `first` >= N with ERROR(NOT_FOUND), detail: N.",
    ),
    (
        "HG-8.6/3",
        "All codes of one reply MUST be of the same latch, whose key and time it names.",
    ),
    (
        "HG-8.6/4",
        "Before the first latch of a session the codes, key and time MUST be 0.",
    ),
    (
        "HG-8.7/1",
        "Trace MUST NOT delay a latch.",
    ),
    (
        "HG-8.7/2",
        "If the uplink has no room, trace events MUST be the first to be dropped, and counted "
        "in `trace_dropped`.",
    ),
    (
        "HG-9.1/1",
        "A board MUST send STATUS every `status_period_ms` while a session is open.",
    ),
    (
        "HG-9.1/2",
        "`last_seq` and `last_latch_us` MUST be 0 before the first latch of a session.",
    ),
    (
        "HG-9.2/1",
        "Every counter MUST start at 0 after a reset, wrap modulo 2^32, and be cleared by "
        "nothing else.",
    ),
    (
        "HG-9.3/1",
        "The margins MUST be those of all stream frames that reached step 13 of HG-3.8 since "
        "the last STATUS or STATUS_REPLY, dropped ones included, and start anew with each of "
        "these; without such a frame all three fields are 0.",
    ),
    (
        "HG-9.4/1",
        "`free_bytes` MUST NOT exceed what the board can take without a pause.",
    ),
    (
        "HG-9.5/1",
        "An event that is dropped at the board MUST NOT use up a sequence number: a gap in "
        "the events is a loss on the line.",
    ),
    (
        "HG-9.6/1",
        "What waits for the uplink MUST be bounded. Trace gives way first, then STATUS, then "
        "responses: the host asks again.",
    ),
    (
        "HG-10.1/1",
        "A request that is answered with ERROR MUST have changed nothing but counters and lease.",
    ),
    (
        "HG-10.1/2",
        "A stream frame MUST NOT be answered.",
    ),
    (
        "HG-10.1/3",
        "A host MUST take an error code that it does not know as a refusal.",
    ),
    (
        "HG-10.2/1",
        "A board MUST use the code that this text gives for a case, and BUSY only for what "
        "will pass by itself.",
    ),
    (
        "HG-11.1/1",
        "Chapter 2, the header, the ranges of types, HELLO, ERROR, the first 8 bytes of "
        "HELLO_REPLY and the effect of MUTE MUST stay as they are in every major version.",
    ),
    (
        "HG-11.2/1",
        "A minor version MAY add message types, capability bits, error codes, may-ignore "
        "flags and values of enumerations; it MUST NOT change the length, layout or meaning "
        "of what is there.",
    ),
    (
        "HG-11.2/2",
        "Both ends MUST use no more than the smaller of their two minor versions offers.",
    ),
    (
        "HG-11.3/1",
        "A host SHOULD warn if the hashes differ although the versions are equal, and MUST "
        "NOT refuse for that reason alone.",
    ),
    (
        "HG-11.4/1",
        "What is to go MUST be named as deprecated here, with its replacement, in a minor "
        "version, and MUST work until the next major version.",
    ),
    (
        "HG-11.4/2",
        "The number of a message, capability bit, error code or flag that is gone MUST NOT be "
        "used again.",
    ),
    (
        "HG-11.4/3",
        "A host SHOULD speak the current major version and the one before; it learns the "
        "board's from ERROR(VERSION).",
    ),
    (
        "HG-11.5/1",
        "`SYNC_IN` (several boards on one trigger) and `COMMIT` (one latch for several "
        "frames) are reserved: a board of this version MUST NOT advertise them, and a host "
        "MUST ignore them. There is one board per port.",
    ),
    (
        "HG-11.5/2",
        "Types, flags, codes and bits that no table of this text names are reserved: a sender "
        "MUST NOT use them.",
    ),
    (
        "HG-12.1/1",
        "A board MUST implement the first five of these timers on the device clock, within 1 ms.",
    ),
    (
        "HG-12.2/1",
        "If the lease of an ARMED board runs out, the board MUST begin a ramp at once.",
    ),
    (
        "HG-12.2/2",
        "Between ARM and the first latch after it, the lease MUST run and the hold MUST NOT.",
    ),
    (
        "HG-12.3/1",
        "The hold MUST run from the last latch, of stream or playback.",
    ),
    (
        "HG-12.4/1",
        "When a playback ends by itself or by STOP, the lease MUST start anew with "
        "`host_timeout_ms`.",
    ),
    (
        "HG-12.5/1",
        "The timer that runs out first MUST begin the ramp; a timer that runs out during a "
        "ramp MUST NOT make the output louder or last longer.",
    ),
    (
        "HG-12.6/1",
        "A host SHOULD compute the timeout by RFC 6298: 250 ms until the first measured round "
        "trip, then SRTT + 4 RTTVAR, at least 50 ms, at most 2 s, doubled with every "
        "retransmission; it MUST NOT measure a request that was sent more than once.",
    ),
    (
        "HG-12.6/2",
        "A host MUST give up after a request was sent 5 times without an answer.",
    ),
)
