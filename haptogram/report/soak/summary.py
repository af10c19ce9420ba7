"""A soak for the page of a CI job."""

from __future__ import annotations

from haptogram.campaigns.soak.campaign import SoakCampaign
from haptogram.campaigns.soak.tally import MEMORY_GREW

from ..formats.job_summary import Finding, JobSummary, Level, SummaryTable
from . import content


def soak_summary(campaign: SoakCampaign) -> JobSummary:
    """Return the summary of *campaign*: its violations, its totals, its faults."""
    sentence = content.soak_sentence(campaign)
    findings = [
        Finding(Level.ERROR, *(example.split(": ", 1))) for example in campaign.tally.examples
    ]
    if not campaign.done:
        findings.append(Finding(Level.ERROR, "segments", sentence))
    if MEMORY_GREW in campaign.failures:
        findings.append(Finding(Level.ERROR, "memory", content.soak_memory(campaign)))
    return JobSummary(
        command="soak",
        sentence=sentence,
        findings=findings,
        facts=list(content.soak_conditions(campaign)),
        tables=[
            SummaryTable("Totals", ("", ""), content.soak_total_rows(campaign.tally)),
            SummaryTable("Faults", content.FAULT_HEAD, content.soak_fault_rows(campaign.tally)),
        ],
    )
