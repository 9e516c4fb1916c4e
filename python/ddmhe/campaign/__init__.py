"""Campaigns: thousands of cases on this machine or a cluster, resumable.

A spec names systems, noise, faults, estimators and seeds; `run` estimates every case of their
product on Dask's workers and keeps a row each, `open` reads what is there. A case is a pure
function of the spec and its number. Needs `pip install 'ddmhe[campaign]'`."""

from ddmhe.campaign.errors import CampaignError
from ddmhe.campaign.opened import Campaign
from ddmhe.campaign.opened import open_campaign as open
from ddmhe.campaign.runner import Progress, run
from ddmhe.campaign.spec import Case, Spec, read_spec

__all__ = ["Campaign", "CampaignError", "Case", "Progress", "Spec", "open", "read_spec", "run"]
