"""A campaign as it was run."""

from __future__ import annotations

from pathlib import Path

from ddmhe.campaign.against import Comparison, compared
from ddmhe.campaign.results import Results
from ddmhe.campaign.store import Store
from ddmhe.checks import check_path

__all__ = ["Campaign", "open_campaign"]


def open_campaign(folder: str | Path) -> Campaign:
    """The campaign of a folder, as far as it is finished; CampaignError where there is none.

    Examples
    --------
    >>> import ddmhe
    >>> campaign = ddmhe.campaign.open("bench-campaign")  # that of the example of `run`
    >>> len(campaign.rows), len(campaign.failed), campaign.complete
    (8, 0, True)
    """
    check_path("folder", folder)
    return Campaign(Store.found(Path(folder)))


class Campaign(Results):
    """A campaign in its folder. What it holds is read when it is first asked for.

    Examples
    --------
    >>> import ddmhe
    >>> campaign = ddmhe.campaign.open("bench-campaign")  # that of the example of `run`
    >>> sorted(campaign.to_xarray().sizes.items())
    [('case', 8), ('span', 1), ('state', 1)]
    >>> campaign.report("page.html")
    >>> [one.reasons for one in campaign.compare(campaign)]  # by its side nothing is worse
    [[], []]
    """

    def compare(self, other: Campaign) -> list[Comparison]:
        """Every estimator on every system against another campaign, case against case."""
        return compared(self, other)

    def report(self, path: str | Path, *, against: Campaign | None = None) -> None:
        """Write a page on it: one HTML file, charts and all, that loads nothing."""
        from ddmhe.campaign.page import write_campaign  # Jinja2 and templates come with it

        write_campaign(self, path, None if against is None else self.compare(against))
