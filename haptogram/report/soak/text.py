"""The account of a soak as text for a terminal."""

from __future__ import annotations

from haptogram.campaigns.soak.campaign import SoakCampaign

from ..formats.console import console_table
from . import content


def soak_text(campaign: SoakCampaign) -> str:
    """Return totals, the faults of every kind and how they were found, counters and verdict."""
    tally = campaign.tally
    conditions, speed = content.soak_conditions(campaign)
    totals = (f"{count:>12} {text}" for count, text in content.soak_total_rows(tally))
    faults = console_table(content.FAULT_HEAD, content.soak_fault_rows(tally), numbers=(1, 2, 3))
    counters = (
        f"{name:>16} {total:>10}  {causes}".rstrip()
        for name, total, causes in content.soak_counter_rows(tally)
    )
    sections = (
        [f"soak: {conditions}", speed],
        totals,
        faults,
        [content.COUNTER_SENTENCE, *counters],
        [content.soak_sentence(campaign), *(f"  {text}" for text in tally.examples)],
    )
    return "\n\n".join("\n".join(section) for section in sections)
