"""The spec of a campaign: which cases there are, each a pure function of the spec and its number.

Scenarios are systems × noise × faults × seeds (and files, of logs), in the order in which the spec
names them, the seed fastest; a case is a scenario with one estimator. What is drawn depends on the
names of system, noise and fault and on the seed, never on the estimator: all estimators see the
same data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ddmhe.campaign.errors import CampaignError
from ddmhe.campaign.estimators import ESTIMATOR, checked_settings, kind_of
from ddmhe.campaign.faults import FAULT
from ddmhe.campaign.files import listed_files
from ddmhe.campaign.systems import SYSTEMS, state_names
from ddmhe.campaign.tables import (
    REQUIRED,
    Key,
    check_name,
    check_tables,
    check_whole_from,
    plain,
    positive,
    size,
    table,
    text,
)
from ddmhe.checks import shown
from ddmhe.config import read_table

__all__ = ["Case", "Part", "Scenario", "Spec", "read_spec"]

NOISE = {"x": Key(size, 0.0), "y": Key(size, 0.0), "later": Key(size, None)}
"""Standard deviations of recorded states, of recorded outputs and of later ones (as recorded)."""
BATCH, BINS = 20, 24


@dataclass(frozen=True)
class Scenario:
    """The data of a case: what is estimated, whoever estimates."""

    system: str
    noise: str
    fault: str
    source: str
    """The file of a log; empty for a simulation."""
    seed: int


@dataclass(frozen=True)
class Case:
    """One estimator on one scenario."""

    number: int
    scenario: Scenario
    estimator: str


@dataclass(frozen=True)
class Part:
    """Scenarios of one system that are run together, with all estimators: first to stop - 1."""

    number: int
    system: str
    first: int
    stop: int


def _listed(name: str, value: Any) -> list[int]:
    """Seeds: how many, or which."""
    if isinstance(value, list | tuple):
        found = [check_whole_from(0)(name, one) for one in value]
        if not found or len(set(found)) != len(found):
            raise CampaignError(f"{name}: expected seeds that differ, found {shown(value)}")
        return found
    return list(range(check_whole_from(1)(name, value)))


def _spans(name: str, value: Any) -> list[float]:
    if not isinstance(value, list | tuple):
        raise CampaignError(f"{name}: expected a list of seconds, found {shown(value)}")
    return sorted({positive(name, one) for one in value})


def _numbers(name: str, value: Any) -> list[int]:
    if not isinstance(value, list | tuple):
        raise CampaignError(f"{name}: expected a list of numbers of cases, found {shown(value)}")
    return sorted({check_whole_from(0)(name, one) for one in value})


KEEP = {
    "spans": Key(_spans, []),  # s after the recording, over which errors are taken
    "traces": Key(_numbers, []),  # cases whose whole run is kept
    "bins": Key(check_whole_from(1), BINS),  # of the error over time
}
TOP = {
    "name": Key(text, "campaign"),
    "seeds": Key(_listed, [0]),
    "batch": Key(check_whole_from(1), BATCH),  # scenarios a task
    "systems": Key(lambda name, value: check_tables(name, value)),
    "noise": Key(lambda name, value: check_tables(name, value), {"none": {}}),
    "faults": Key(lambda name, value: check_tables(name, value), {"none": {}}),
    "estimators": Key(lambda name, value: check_tables(name, value)),
    "keep": Key(lambda name, value: value, {}),
}
ORDERED = ("systems", "noise", "faults", "estimators")


def read_spec(spec: str | Path | Mapping[str, Any] | Spec) -> Spec:
    """A checked spec, from a TOML file or from what such a file holds.

    CampaignError or ConfigError, one sentence that names the key: unknown ones with the nearest
    known, lacking ones, values that do not fit, settings that an estimator does not have.

    Examples
    --------
    >>> import ddmhe
    >>> bench = {"systems": {"bench": {}}, "estimators": {"DdMhe": {}, "RidgeFir": {}}}
    >>> spec = ddmhe.campaign.read_spec({**bench, "seeds": 100})
    >>> spec.cases, len(spec.parts)
    (200, 5)
    """
    if isinstance(spec, Spec):
        return spec
    given = spec if isinstance(spec, Mapping) else read_table(spec)
    top = table("", plain(given), TOP)
    systems = {name: _system(name, of) for name, of in top["systems"].items()}
    noise = {name: table(f"noise.{name}", of, NOISE) for name, of in top["noise"].items()}
    for of in noise.values():
        of["later"] = of["y"] if of["later"] is None else of["later"]
    faults = {name: table(f"faults.{name}", of, FAULT) for name, of in top["faults"].items()}
    estimators = {name: _estimator(name, of) for name, of in top["estimators"].items()}
    keep = table("keep", top["keep"], KEEP)
    made = Spec(top["name"], tuple(top["seeds"]), top["batch"], systems, noise, faults,
                estimators, keep)  # fmt: skip
    _check_together(made)
    return made


def _system(name: str, given: Any) -> dict[str, Any]:
    where = f"systems.{name}"
    if not isinstance(given, Mapping):
        raise CampaignError(f"{where}: expected a table, found {shown(given)}")
    kind = given.get("kind", name)
    if not isinstance(kind, str) or kind not in SYSTEMS:
        check_name(f"{where}.kind", kind, SYSTEMS)
    known = dict(SYSTEMS[kind].keys)
    if kind == "log":
        known["sources"] = Key(lambda _, value: list(value), None)
    found = table(where, {"kind": kind} | dict(given), known)
    if kind == "log" and found["sources"] is None:
        found["sources"] = listed_files(f"{where}.files", found["files"])
    if kind != "log":
        for key in ("recorded", "duration"):
            steps = found[key] / found["dt"]
            if abs(steps - round(steps)) > 1e-6 * steps or round(steps) < 1:
                raise CampaignError(
                    f"{where}.{key}: expected a multiple of dt = {found['dt']:g} s, found "
                    f"{found[key]:g}"
                )
    return found


def _estimator(name: str, given: Any) -> dict[str, Any]:
    where = f"estimators.{name}"
    kind = kind_of(where, name, given)
    found = table(where, {"kind": kind} | dict(given), ESTIMATOR)
    checked_settings(where, kind, found["settings"])
    return found


def _check_together(spec: Spec) -> None:
    """What one table says of another."""
    for name, system in spec.systems.items():
        for level, of in spec.noise.items():
            if system["kind"] == "log" and (np.any(of["x"]) or np.any(of["y"])):
                raise CampaignError(
                    f"noise.{level}: expected no x and y beside systems.{name}, whose recordings "
                    "have their own, found some"
                )
    durations = [system.get("duration") or float("inf") for system in spec.systems.values()]
    late = [seconds for seconds in spec.keep["spans"] if seconds > max(durations)]
    if late:
        raise CampaignError(
            f"keep.spans: expected at most {max(durations):g} s, which is estimated, found "
            f"{late[0]:g}"
        )
    beyond = [number for number in spec.keep["traces"] if number >= spec.cases]
    if beyond:
        raise CampaignError(f"keep.traces: expected cases below {spec.cases}, found {beyond[0]}")


@dataclass(frozen=True, eq=False)
class Spec:
    """A checked spec, all defaults filled in; `read_spec` makes it.

    Examples
    --------
    >>> import ddmhe
    >>> bench = {"systems": {"bench": {}}, "estimators": {"DdMhe": {}}}
    >>> spec, other = (ddmhe.campaign.read_spec({**bench, "seeds": n}) for n in (3, 4))
    >>> spec.case(2).scenario.seed
    2
    >>> list(spec.differences(other))
    ['seeds was 3, is 4']
    """

    name: str
    seeds: tuple[int, ...]
    batch: int
    systems: Mapping[str, Mapping[str, Any]]
    noise: Mapping[str, Mapping[str, Any]]
    faults: Mapping[str, Mapping[str, Any]]
    estimators: Mapping[str, Mapping[str, Any]]
    keep: Mapping[str, Any]

    @cached_property
    def plain(self) -> dict[str, Any]:
        """In values of JSON; `read_spec` makes the same spec of it."""
        names = ("name", "batch", *ORDERED, "keep")
        found: dict[str, Any] = {name: plain(getattr(self, name)) for name in names}
        counted = self.seeds == tuple(range(len(self.seeds)))
        return found | {"seeds": len(self.seeds) if counted else list(self.seeds)}

    @cached_property
    def hash(self) -> str:
        """SHA-256 of all values and of the order of tables; 1 and 1.0 are the same number."""
        ordered = {name: list(map(list, self.plain[name].items())) for name in ORDERED}
        text = json.dumps(_floats(self.plain | ordered), sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def _sizes(self) -> dict[str, int]:
        """Scenarios of each system."""
        each = len(self.noise) * len(self.faults) * len(self.seeds)
        return {name: each * len(of.get("sources", [""])) for name, of in self.systems.items()}

    @property
    def scenarios(self) -> int:
        """Number of scenarios."""
        return sum(self._sizes.values())

    @property
    def cases(self) -> int:
        """Number of cases."""
        return self.scenarios * len(self.estimators)

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """What is run and stored together."""
        found: list[Part] = []
        begin = 0
        for system, count in self._sizes.items():
            for first in range(begin, begin + count, self.batch):
                stop = min(first + self.batch, begin + count)
                found.append(Part(len(found), system, first, stop))
            begin += count
        return tuple(found)

    def scenario(self, number: int) -> Scenario:
        """The scenario of this number."""
        rest = number
        system = ""
        for name, count in self._sizes.items():
            if rest < count:
                system = name
                break
            rest -= count
        if not system:
            raise CampaignError(
                f"scenario: expected a number below {self.scenarios}, found {number}"
            )
        rest, seed = divmod(rest, len(self.seeds))
        sources = self.systems[system].get("sources", [""])
        rest, source = divmod(rest, len(sources))
        noise, fault = divmod(rest, len(self.faults))
        return Scenario(
            system, list(self.noise)[noise], list(self.faults)[fault], sources[source],
            self.seeds[seed],
        )  # fmt: skip

    def case(self, number: int) -> Case:
        """The case of this number: of its scenario, in the order of the estimators."""
        check_whole_from(0)("case", number)
        if number >= self.cases:
            raise CampaignError(f"case: expected a number below {self.cases}, found {number}")
        scenario, estimator = divmod(number, len(self.estimators))
        return Case(number, self.scenario(scenario), list(self.estimators)[estimator])

    def cases_of(self, scenario: int) -> list[Case]:
        """All estimators on one scenario."""
        of, each = self.scenario(scenario), len(self.estimators)
        return [Case(scenario * each + k, of, name) for k, name in enumerate(self.estimators)]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states of all systems, each once."""
        every = [name for of in self.systems.values() for name in state_names(of)]
        return tuple(dict.fromkeys(every))

    @property
    def spans(self) -> dict[str, float]:
        """Spans over which errors are taken, by their names in columns, s; "all" is the run."""
        return {f"{s:g}s": s for s in self.keep["spans"]} | {"all": float("inf")}

    def differences(self, other: Spec) -> Iterator[str]:
        """Where another spec differs, a phrase each."""
        yield from _differences("", self.plain, other.plain)
        for name in ORDERED:
            if list(self.plain[name]) != list(other.plain[name]):
                yield f"the order of {name}"


def _floats(value: Any) -> Any:
    """The same with all numbers as floats."""
    if isinstance(value, dict):
        return {key: _floats(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_floats(one) for one in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _differences(where: str, a: Any, b: Any) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys([*a, *b]):
            place = f"{where}.{key}" if where else key
            yield from _differences(place, a.get(key, REQUIRED), b.get(key, REQUIRED))
    elif a != b:
        words = ["nothing" if one is REQUIRED else shown(one) for one in (a, b)]
        yield f"{where} was {words[0]}, is {words[1]}"
