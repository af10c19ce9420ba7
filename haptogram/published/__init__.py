"""Systems behind the paper and open boards, each with its published figures next to ours."""

from haptogram.published.catalogue import PRESETS, find_preset
from haptogram.published.figures import Preset, PublishedFigure, compare_preset

__all__ = ["PRESETS", "Preset", "PublishedFigure", "compare_preset", "find_preset"]
