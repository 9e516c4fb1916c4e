"""What goes wrong with a campaign as a whole, and the libraries that one needs."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ddmhe._core import DdmheError

__all__ = ["CampaignError", "library"]


class CampaignError(DdmheError):
    """A campaign cannot be run, resumed or read.

    Examples
    --------
    >>> import ddmhe
    >>> try:
    ...     ddmhe.campaign.read_spec({"sistems": {}})
    ... except ddmhe.campaign.CampaignError as e:
    ...     print(str(e).split("found ")[1])
    'sistems'; did you mean 'systems'?
    """


def library(name: str) -> Any:
    """A library of the extra `campaign`; CampaignError that names the extra where it is not
    installed."""
    try:
        return import_module(name)
    except ImportError:
        raise CampaignError(
            f"campaign: expected the library {name.partition('.')[0]}, found that it is not "
            "installed: pip install 'ddmhe[campaign]'"
        ) from None
