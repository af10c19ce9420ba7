"""Random dialogues, judged by the virtual board as a model beside the board under test.

Time is cut into slots.  Bytes are sent at the beginning of a slot; everything that a board does by
itself is due inside one, so that a host that is late by an eighth of a slot changes nothing that is
compared.  In most dialogues no timer ends: a slot is over as soon as the board has answered, unless
the model is about to do something.

Hypothesis's state machines are not used: an example takes seconds of the wall clock on a board,
a replay may differ because the host was held up, and actions here are independent of each other, so
that leaving some out is all the shrinking there is to do.
"""
