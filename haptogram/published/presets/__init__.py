"""Systems behind the paper and open boards, each with its published figures next to ours."""

from haptogram.published.presets.catalogue import PRESETS, find_preset
from haptogram.published.presets.figures import Figure, Preset, compare

__all__ = ["PRESETS", "Figure", "Preset", "compare", "find_preset"]
