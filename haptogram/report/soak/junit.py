"""A soak as a JUnit suite: one case for each event that must not happen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from haptogram.campaigns.soak.campaign import SoakCampaign
from haptogram.campaigns.soak.tally import MEMORY_GREW, VIOLATIONS
from haptogram.machine.provenance import UNSTATED, Provenance

from ..formats.junit import JUnit, JUnitCase, JUnitSuite, write_junit
from . import content


def write_soak_junit(
    path: Path, campaign: SoakCampaign, *, provenance: Provenance = UNSTATED
) -> None:
    """Write the account as JUnit XML; a soak that did not come to its end is an ``error``.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    setup = campaign.setup.as_dict().items()
    properties = {name: str(value) for name, value in setup if value is not None}
    totals = {f"totals.{name}": str(n) for name, n in sorted(campaign.tally.totals.items())}
    suite = JUnitSuite(
        "haptogram.soak",
        tuple(_soak_junit_cases(campaign)),
        properties | totals | dict(provenance.rows()),
        "\n".join([content.soak_sentence(campaign), *content.soak_conditions(campaign)]),
        provenance.timestamp,
        campaign.spent_s,
    )
    write_junit(path, suite)


def _soak_junit_cases(campaign: SoakCampaign) -> Iterator[JUnitCase]:
    for name, statement in VIOLATIONS.items():
        count = campaign.failures.get(name, 0)
        if count:
            message = f"{name}: {count} times" if count > 1 else f"{name}: once"
            told = [text for text in campaign.tally.examples if f", {name}: " in text]
            told += [content.soak_memory(campaign)] if name == MEMORY_GREW else []
            outcome, text = JUnit.FAILURE, "\n".join([message, *told])
        elif campaign.done:
            message = text = f"{name}: never, in {campaign.done_s:g} s of virtual time"
            outcome = JUnit.PASSED
        else:
            message = text = "no segment came to its end"
            outcome = JUnit.SKIPPED
        yield JUnitCase("violations", statement, outcome, message, name, text)
    message = f"{campaign.done} of {campaign.setup.segments} segments"
    outcome = JUnit.PASSED if campaign.is_complete else JUnit.ERROR
    seconds = campaign.spent_s
    yield JUnitCase(
        "segments", "the soak comes to its end", outcome, message, "cut short", message, "", seconds
    )
