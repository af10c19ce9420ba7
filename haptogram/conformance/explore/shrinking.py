"""A dialogue that differs, made short: actions are left out as long as it still differs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .actions import DialogueAction


def shrink_dialogue(
    actions: Sequence[DialogueAction],
    differs: Callable[[Sequence[DialogueAction]], bool],
    tries: int,
) -> list[DialogueAction]:
    """Return a part of *actions* that still differs, after at most *tries* replays.

    Halves, quarters and so on are left out, at last single actions.

    Examples
    --------
    >>> shrink_dialogue("abcdef", lambda part: "b" in part and "e" in part, tries=50)
    ['b', 'e']
    """
    kept, size = list(actions), len(actions) // 2
    while size and tries:
        start = 0
        while start < len(kept) and tries:
            rest = kept[:start] + kept[start + size :]
            tries -= 1
            if differs(rest):
                kept = rest
            else:
                start += size
        size //= 2
    return kept
