"""The account of a soak as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from haptogram.campaigns.soak.campaign import SoakCampaign
from haptogram.machine.provenance import UNSTATED, Provenance

from ..figures.embedded import embed_picture
from ..formats.html import check_html_page, write_html_page
from . import content
from .pictures import draw_soak_course

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
    check_html_page()
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
        course=embed_picture(
            draw_soak_course(campaign),
            "The course of the soak.",
            "Damaged frames are those that either end found; lost and late ones are those to the "
            "board. A frame is late by the time from its due time to its arrival. "
            f"Each step is {campaign.setup.interval_s:g} s.",
        )
        if tally.course
        else None,
        fault_head=content.FAULT_HEAD,
        faults=content.soak_fault_rows(tally),
        totals=content.soak_total_rows(tally),
        counter_head=content.COUNTER_HEAD,
        counters=list(content.soak_counter_rows(tally)),
    )
