"""Damaged logs, settings, blobs and command lines: an answer, or one sentence of ours."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import ddmhe
from commands import in_here
from ddmhe.config import read_config, write_config
from ddmhe.recordings import read_log

ROWS = [f"{k / 10:.1f},{np.cos(k / 3):.4f},{np.cos(k / 3) + 0.1:.4f},{k % 3}" for k in range(40)]
LOG = ("t,a,y,u\n" + "\n".join(ROWS) + "\n").encode()
CONFIG = tomli_w.dumps(
    {
        "horizon": 5,
        "rho": 0.9,
        "mu": 2.0,
        "x_bounds": [[-1.0], [1.0]],
        "soft": {"x": 10.0, "v": 100.0},
        "equilibrium": [[0.0], [0.0]],
        "process_noise": [[1e-4]],
        "space": {"kind": "ridge", "weight": 1e-2, "normalised": True},
        "missing": [-9999],
        "certificate": {"eta": 0.9, "P": [[1.0]], "Q": [[2.0]], "R": [[0.5]]},
    }
).encode()
H = ddmhe.History(np.cos(np.arange(31.0))[:, None], np.sin(np.arange(30.0))[:, None])
PLACE = Path(tempfile.mkdtemp(prefix="ddmhe-attack-"))
PIECES = (
    b"", b"\0", b"\n", b"\r", b",", b'"', b";", b"nan", b"inf", b"-9999", b"1e400", b"\xff\xfe",
    b"\xef\xbb\xbf", "é".encode("latin-1"), "٣".encode(), b"1_0", b"0x1", b"t", b"a,a", b"[", b"]",
    b"{", b"=", b"#", b"'''", b"true", b"2026-01-01", b" " * 300, b"9" * 400,
    b'"a\nb",', b"\x1b[2J", "\u2028".encode(), b"$", b"[/b]",
)  # fmt: skip
LONGEST = 1500
"""Characters of a sentence of ours, whatever names, cells and paths it tells."""
NASTY = ("a\nb", "a\r\x1b[2Jb", "a\u2028b", "a" * 5000, "[/b]", "a  b", 'a"b', "\u202eb")
"""Names and texts that are long, not of one line, or obeyed by a terminal."""
WIDE = [f"column {k}" for k in range(3000)]


def profile(examples):
    """Without a clock: the machine may be busy."""
    return settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


@st.composite
def damaged(draw, whole):
    """These bytes with up to six pieces replaced, doubled or lost."""
    found = bytearray(whole)
    for _ in range(draw(st.integers(0, 6))):
        at = draw(st.integers(0, len(found)))
        end = min(len(found), at + draw(st.sampled_from([0, 0, 1, 1, 4, 40, 400])))
        piece = st.one_of(st.sampled_from(PIECES), st.binary(max_size=5), st.just(bytes(whole)))
        found[at:end] = draw(piece)
    return bytes(found)


def sentence(call):
    """What it returns; None after an error of ours in one line."""
    try:
        return call()
    except ddmhe.DdmheError as e:
        words = str(e)
    assert words
    assert words.isprintable(), words
    assert len(words) < LONGEST, words
    return None


def a_log(data, how):
    path = PLACE / "log.csv"
    path.write_bytes(data)
    options = {"decimate": 1 + how % 2, "missing": [-9999.0] if how & 4 else []}
    names = (["a"], ["y"]) if how & 8 else (["a"], ["a", "y"])
    if how & 16:
        options["unwrap"] = ["a"]
    log = sentence(lambda: read_log(path, *names, input=["u"] if how & 2 else (), **options))
    if log is not None:
        assert np.isfinite(log.t).all()
        assert not np.isinf(log.x).any()
        assert not np.isinf(log.y).any()
        for part in (lambda: log, log.fill_gaps):
            sentence(lambda part=part: part().split(1.5))


def a_config(data):
    path = PLACE / "est.toml"
    path.write_bytes(data)
    found = sentence(lambda: read_config(path))
    if found is not None:
        found.pop("missing", None)
        sentence(lambda: ddmhe.DdMhe(H, **found))


def a_blob(data):
    for read in (ddmhe.History.from_bytes, ddmhe.DdMhe.restore):
        sentence(lambda read=read: read(data))


ARGUMENTS = (
    "--horizon", "0", "-1", "5", "1e9", "99999999999999999999", "--rho", "nan", "1", "--mu", "inf",
    "--space", "exact", "truncated:-1", "ridge:x", "--start-from", "unknown", "recording",
    "--start", "1e300", "--decimate", "2", "--gaps", "error", "--missing", "-9999,x", "--unwrap",
    "a", "--input", "u", "u,u", "--history", "1.5", "--config", "nowhere.toml", "--plot", "p.xyz",
    "p.png",
    "--out", "/", ".", "log.csv", "--warm-start", "--no-warm-start", "--time", "t", "", "ü", "--",
    "-",
)  # fmt: skip


def a_command(arguments, data):
    (PLACE / "log.csv").write_bytes(data)
    usual = ["--state", "a", "--output", "y", "--history", "1.5", "--out", "est.csv"]
    result = in_here("estimate", "log.csv", *usual, *arguments, cwd=PLACE)
    assert result.returncode in (0, 2), result
    told = result.stderr.splitlines()
    if result.returncode == 2:
        assert told[-1].startswith("ddmhe: error:")
    assert all(line.startswith("ddmhe: ") and line.isprintable() for line in told), told
    assert result.stdout.replace("\n", "").isprintable()


TYPESET = ["$\\frac$", "[/b]", "rate [rad/s]", "a\nb\x1b[2J", "_{0}%s", "中"]


@pytest.mark.parametrize("name", TYPESET, ids=range(len(TYPESET)))
def test_names_are_shown_letter_by_letter(name):
    """In tables and figures, which have styles and formulas of their own."""
    place = PLACE / "typeset"
    place.mkdir(exist_ok=True)
    x = np.cumsum(np.random.default_rng(0).standard_normal((150, 2)), axis=0)
    rows = [f"{k / 10},{a!r},{a + 0.5!r},{b!r}" for k, (a, b) in enumerate(x.tolist())]
    place.joinpath("log.csv").write_text("\n".join([f'"{name} lower","{name}",y,z', *rows]))
    how = ["log.csv", "--state", name, "--output", "y,z", "--history", "10"]
    estimated = ["estimate", *how, "--out", "est.csv", "--plot", "est.png"]
    for words in (estimated, ["interval", *how, "--accept-wide"], ["design", *how]):
        result = in_here(*words, cwd=place)
        assert result.returncode == 0, result
        assert all(line.startswith("ddmhe: ") for line in result.stderr.splitlines())
        assert result.stdout.replace("\n", "").isprintable()
        if words[0] != "design":
            assert ddmhe.checks.one_line(name) in result.stdout
    assert place.joinpath("est.png").exists()


HOW = st.integers(0, 31)
WORDS = st.lists(st.sampled_from(ARGUMENTS), max_size=4)


@profile(60)
@given(damaged(LOG), HOW)
def test_a_damaged_log(data, how):
    a_log(data, how)


@profile(60)
@given(damaged(CONFIG))
def test_a_damaged_configuration(data):
    a_config(data)


@profile(60)
@given(damaged(H.to_bytes()))
def test_a_damaged_blob(data):
    a_blob(data)


@profile(10)
@given(WORDS, damaged(LOG))
def test_an_odd_command(arguments, data):
    a_command(arguments, data)


def refused(call):
    """The sentence that it is refused with."""
    with pytest.raises(ddmhe.DdmheError) as e:
        call()
    sentence(call)
    return str(e.value)


def log_with(cells, rows=ROWS):
    """A log whose header has these cells after t, a, y, u."""
    quoted = ",".join('"' + cell.replace('"', '""') + '"' for cell in cells)
    path = PLACE / "names.csv"
    rows = [row + ",1" * len(cells) for row in rows]
    path.write_bytes(("\n".join([f"t,a,y,u,{quoted}", *rows]) + "\n").encode())
    return path


def test_a_header_with_line_breaks_is_told_in_one_line():
    path = log_with(["first\nsecond"])
    told = refused(lambda: read_log(path, ["b"], ["y"]))
    assert told == (
        f"state: expected a column of {path}, found 'b' "
        r"(columns: t, a, y, u, 'first\nsecond')"
    )


def test_of_many_columns_the_first_are_told():
    path = log_with(WIDE, ROWS[:3])
    told = refused(lambda: read_log(path, ["column 3000"], ["y"]))
    assert "did you mean 'column 300'" in told
    assert told.endswith("column 34, column 35 and 2964 more)")


@pytest.mark.parametrize("name", NASTY, ids=range(len(NASTY)))
def test_names_and_cells_are_told_in_one_line(name):
    twice = log_with([name, name])
    for time, wanted, unwrap in (
        (None, name, ()), (name, "a", ()), (None, name + "c", ()), (name + "c", "a", ()),
        (None, "a", [name]),
    ):  # fmt: skip
        refused(lambda t=time, s=wanted, w=unwrap: read_log(twice, [s], ["y"], t, unwrap=w))
    once = log_with([name], [*ROWS[:30], *ROWS[31:]])
    refused(lambda: read_log(once, ["a"], ["y"], name))  # no times
    refused(lambda: read_log(once, [name, name], ["y"]))
    refused(lambda: read_log(once, ["a"], ["y"], input=[name]).fill_gaps().split(1.5))
    cell = '"' + name.replace('"', '""') + '"'
    once.write_text("\n".join(["t,a,y,u", f"s,{cell},,", *ROWS, f"4.0,{cell},1,1"]), newline="")
    refused(lambda: read_log(once, ["a"], ["y"]))
    once.write_text("\n".join(["t,a,y,u", f"{cell},m,m,m", *ROWS]), newline="")
    refused(lambda: read_log(once, ["a"], ["y"]))
    once.write_text("\n".join([f"t,{cell},y,u", *ROWS[:9], "0.9,,1,1", *ROWS[10:]]), newline="")
    refused(lambda: read_log(once, [name], ["y"]).split(1.5))


@pytest.mark.parametrize("name", NASTY, ids=range(len(NASTY)))
def test_paths_are_told_in_one_line(name):
    place = PLACE / ("nowhere" + name.replace("/", ""))
    refused(lambda: read_log(place, ["a"], ["y"]))
    refused(lambda: read_config(place))
    refused(lambda: write_config(place / "est.toml", {"horizon": 5}))
    refused(lambda: ddmhe.models.TorqueCurve.from_csv(place))


@pytest.mark.parametrize("name", NASTY, ids=range(len(NASTY)))
@pytest.mark.parametrize(
    "table",
    [
        {"NAME": 1}, {"horizon": "NAME"}, {"space": "NAME"}, {"space": {"kind": "NAME"}},
        {"space": {"kind": "ridge", "weight": "NAME"}}, {"space": {"kind": "ridge", "NAME": 1}},
        {"certificate": "NAME"}, {"certificate": {"NAME": 1}}, {"missing": [["NAME"]]},
        {"certificate": {"eta": 0.9, "P": [["NAME"]], "Q": [[1.0]], "R": [[1.0]]}},
        {"x_bounds": [["NAME"], [1.0]]}, {"NAME": {"NAME": "NAME"}},
    ],
    ids=range(12),
)  # fmt: skip
def test_settings_of_a_file_are_told_in_one_line(table, name):
    def named(value):
        if isinstance(value, dict):
            return {key.replace("NAME", name): named(v) for key, v in value.items()}
        if isinstance(value, list):
            return [named(v) for v in value]
        return value.replace("NAME", name) if isinstance(value, str) else value

    path = PLACE / "est.toml"
    path.write_text(tomli_w.dumps(named(table)))
    refused(lambda: read_config(path))


@pytest.mark.parametrize(
    "text", ["rho = " + "9" * 5000, "x_bounds = " + "[" * 5000, "x = {" + "a" * 5000 + "=1, "]
)
def test_what_toml_cannot_hold_is_one_sentence(text):
    path = PLACE / "est.toml"
    path.write_text(text)
    refused(lambda: read_config(path))


PACKED = {
    "gz": b"\x1f\x8b",
    "zip": b"PK\x03\x04",
    "xz": b"\xfd7zXZ\0",
    "bz2": b"BZh9",
    "zst": b"\x28\xb5\x2f\xfd",
    "tar": b"log.csv" + bytes(99),
}


@pytest.mark.parametrize("ending", PACKED)
def test_what_cannot_be_unpacked_is_one_sentence(ending):
    path = PLACE / f"log.csv.{ending}"
    path.write_bytes(PACKED[ending] + LOG)
    refused(lambda: read_log(path, ["a"], ["y"]))


@pytest.mark.parametrize("number", [10**30, 10**400, -(10**5000)], ids=["30", "400", "5000"])
def test_whole_numbers_beyond_a_double_are_one_sentence(number):
    path = PLACE / "log.csv"
    path.write_bytes(LOG)
    refused(lambda: read_log(path, ["a"], ["y"], decimate=number))
    refused(lambda: read_log(path, ["a"], ["y"], missing=[number * 10**400]))
    refused(lambda: read_log(path, ["a"], ["y"], start=abs(number)))
    refused(lambda: read_log(path, ["a"], ["y"]).split(number))


SNAPSHOTS = sorted(Path(__file__).parents[1].joinpath("fuzz", "corpus", "snapshot").iterdir())


def test_the_fuzzers_start_from_snapshots_of_this_format():
    assert len(SNAPSHOTS) > 8
    for path in SNAPSHOTS:
        assert ddmhe.DdMhe.restore(path.read_bytes()).next_depth >= 1


class Named:
    """Something whose own words are those of the attack."""

    def __init__(self, name):
        self.name = name
        self.__class__ = type(name.replace("\0", ""), (Named,), {})

    def __repr__(self):
        return self.name

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError(self.name)


@pytest.mark.parametrize("name", NASTY, ids=range(len(NASTY)))
def test_arguments_are_told_in_one_line(name):
    odd, x, y = Named(name), [[0.0], [1.0], [2.0]], [[1.0], [2.0]]
    record = np.zeros(2, dtype=[(name, float), *((f"field {k}", float) for k in range(300))])
    other = ddmhe.History(x, y, x_units=[name])
    plain = ddmhe.History(x, y)
    certificate = ddmhe.design.Certificate(0.9, *[np.eye(1)] * 3, 0.0)
    object.__setattr__(certificate, name, 1)
    for call in (
        lambda: ddmhe.DdMhe(H, 5, weights=name), lambda: ddmhe.DdMhe(H, 5, start=name),
        lambda: ddmhe.DdMhe(H, 5, soft={name: 1.0}), lambda: ddmhe.DdMhe(H, 5, soft=odd),
        lambda: ddmhe.DdMhe(H, odd), lambda: ddmhe.DdMhe(odd), lambda: ddmhe.DdMhe(H, 5, rho=odd),
        lambda: ddmhe.DdMhe(H, 5, x_prior=odd), lambda: ddmhe.DdMhe(H, 5, x_prior=record),
        lambda: ddmhe.DdMhe(H, 5, x_bounds=odd), lambda: ddmhe.DdMhe(H, 5, space=odd),
        lambda: ddmhe.DdMhe(H, 5, certificate=certificate), lambda: ddmhe.History(odd, y),
        lambda: ddmhe.History(record, y), lambda: ddmhe.History(x, y, x_units=[odd] * 1000),
        lambda: ddmhe.History.concat([plain, other]), lambda: ddmhe.History.concat([odd]),
        lambda: ddmhe.History.concat([other, plain]), lambda: ddmhe.History.concat(odd),
        lambda: ddmhe.History.from_bytes(odd), lambda: ddmhe.DdMhe.restore(odd),
        lambda: ddmhe.Zonotope([0.0], [[1.0]]).minkowski_sum(odd),
        lambda: ddmhe.Zonotope([0.0], [[1.0]]).reduce(1, name), lambda: ddmhe.run_many(odd, []),
        lambda: ddmhe.run_many([odd], [y]), lambda: ddmhe.models.pendulum(**{name: 1}),
    ):  # fmt: skip
        refused(call)
    with pytest.raises(TypeError) as e:
        ddmhe.DdMhe(H, 5, **{name: 1})
    assert str(e.value).isprintable()
    assert len(str(e.value)) < LONGEST


@pytest.mark.long
@profile(3000)
@given(damaged(LOG), HOW)
def test_long_a_damaged_log(data, how):
    a_log(data, how)


@pytest.mark.long
@profile(3000)
@given(damaged(CONFIG))
def test_long_a_damaged_configuration(data):
    a_config(data)


@pytest.mark.long
@profile(150)
@given(WORDS, damaged(LOG))
def test_long_an_odd_command(arguments, data):
    a_command(arguments, data)
