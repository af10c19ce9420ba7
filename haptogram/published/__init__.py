"""Systems behind the paper and open boards, each with its published figures next to ours."""

from haptogram.published.catalogue import PRESETS, Preset, compare_preset, find_preset

__all__ = ["PRESETS", "Preset", "compare_preset", "find_preset"]
