"""The account of a soak as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from haptogram.campaigns.soak.campaign import SoakCampaign
from haptogram.machine.provenance import UNSTATED, Provenance

from ..formats.html import write_html_page
from . import content

_TONES: Final = {"PASS": "good", "FAIL": "bad", "INCONCLUSIVE": "doubt"}


def write_soak_page(
    path: Path, campaign: SoakCampaign, *, provenance: Provenance = UNSTATED
) -> None:
    """Write the account: what must not happen first, then faults, totals and counters.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    sentence = content.soak_sentence(campaign)
    verdict = sentence.partition(":")[0].partition(",")[0]
    tally = campaign.tally
    write_html_page(
        path,
        "soak.html",
        provenance,
        title=f"Haptogram: soak, {verdict.lower()}",
        heading=sentence,
        tone=_TONES[verdict],
        lead=[f"{text[0].upper()}{text[1:]}." for text in content.soak_conditions(campaign)],
        violations=[(name, str(count)) for name, count in campaign.failures.items()],
        examples=tally.examples,
        fault_head=content.FAULT_HEAD,
        faults=content.soak_fault_rows(tally),
        totals=content.soak_total_rows(tally),
        counter_head=content.COUNTER_HEAD,
        counters=list(content.soak_counter_rows(tally)),
    )
