"""Stream frames in the queue, in every slot and at every time, and frames that come together."""
