"""A spec tried before its campaign begins: a setting out of range is one error then, and not one in
every row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ddmhe._core import DdmheError
from ddmhe.campaign.data import Data, data_of
from ddmhe.campaign.errors import CampaignError
from ddmhe.campaign.estimators import made
from ddmhe.campaign.spec import Spec

__all__ = ["check_settings_of"]


def check_settings_of(spec: Spec) -> None:
    """CampaignError, which names the key, where an estimator takes none of a few recordings of a
    system because of a setting, or where a noise or a fault does not fit a system.

    One recording of each noise and fault is tried, and the last. What fails for another reason, or
    on some recordings alone, is a failing case."""
    for system in spec.systems:
        recordings = list(_recordings(spec, system))
        for name, table in spec.estimators.items():
            words = _refusal(table, recordings) if table["settings"] else ""
            if words:
                where = f"estimators.{name}.settings"
                raise CampaignError(f"{where}.{words} (systems.{system})")


def _recordings(spec: Spec, system: str) -> Iterator[Data]:
    """A recording of each noise and fault of a system, and its last; without those that fail."""
    parts = [part for part in spec.parts if part.system == system]
    first, stop = parts[0].first, parts[-1].stop
    each = (stop - first) // (len(spec.noise) * len(spec.faults))
    for number in dict.fromkeys([*range(first, stop, each), stop - 1]):
        scenario = spec.scenario(number)
        try:
            yield data_of(spec, scenario)
        except DdmheError as e:
            about, _, words = str(e).partition(".")
            level = {"noise": scenario.noise, "faults": scenario.fault}.get(about)
            if level is not None:
                raise CampaignError(f"{about}.{level}.{words} (systems.{system})") from e
        except Exception:  # it is a failing case: a log that cannot be read
            continue


def _refusal(table: Mapping[str, Any], recordings: list[Data]) -> str:
    """What an estimator says of its settings where it takes none of the recordings."""
    settings = table["settings"]
    if table["kind"] == "tuned":  # what is found for it is not out of range
        table = dict(table) | {"kind": "DdMhe"}
    words = ""
    for data in recordings:
        try:
            made(table, data.history, data.noise)
        except Exception as e:
            words = str(e)
            about = words.partition(":")[0].split(", ")
            if not any(name in settings for name in about):
                return ""
        else:
            return ""
    return words
