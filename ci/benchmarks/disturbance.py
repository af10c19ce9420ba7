"""How much of the machine others had while something was measured: Linux tells it in /proc/stat."""

import os
from pathlib import Path

STAT = Path("/proc/stat")
MOST_STOLEN = 0.05  # of the processors' time, before a row is measured again


class Disturbance:
    """Shares of the processors' time from here on; 0 where the system does not tell them."""

    def __init__(self):
        self.then = ticks()

    @property
    def stolen(self):
        """The share that a hypervisor gave to other machines."""
        return self._share(lambda spent: spent["steal"])

    @property
    def others(self):
        """The share that other processes took."""
        return self._share(lambda spent: spent["busy"] - spent["own"])

    def _share(self, part):
        spent = {name: now - self.then[name] for name, now in ticks().items()}
        return max(0.0, part(spent) / spent["all"]) if spent.get("all") else 0.0


def ticks():
    """Return ticks of all processors, busy ones, those stolen, and those of this process."""
    if not STAT.exists():
        return {}
    line = STAT.read_text("utf-8").partition("\n")[0]
    user, nice, system, idle, iowait, irq, softirq, steal = map(int, line.split()[1:9])
    busy = user + nice + system + irq + softirq
    own = sum(os.times()[:4]) * os.sysconf("SC_CLK_TCK")
    return {"all": busy + idle + iowait + steal, "busy": busy, "steal": steal, "own": own}


def undisturbed(measure):
    """Return what *measure* finds, measured again if the machine was taken away, and how far."""
    found, stolen = _watched(measure)
    return (found, stolen) if stolen <= MOST_STOLEN else _watched(measure)


def _watched(measure):
    watch = Disturbance()
    found = measure()
    return found, round(watch.stolen, 3)
