"""The same log in every format gives identical bits; what a format needs is named."""

import builtins
import gzip
import io
import json
import subprocess
import sys

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import zstandard
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as RosWriter
from pyarrow import feather, parquet
from scipy.io import savemat

from commands import in_here
from ddmhe.recordings import LogError, read
from odd_logs import EPOCH, HEAD, HISTORY, N, numbers

NUMBERS = numbers()
COLUMNS = dict(zip(HEAD, NUMBERS.T, strict=True))
COMMON = {"state": ["w1", "w2"], "output": ["q1"], "history": HISTORY}
STAMPS = EPOCH + 20_000_000 * np.arange(N)


def csv_bytes():
    """Every digit of a float64."""
    return pd.DataFrame(COLUMNS).to_csv(index=False).encode()


def hdf5_file(path, columns=COLUMNS, **options):
    with h5py.File(path, "w", **options) as file:
        for name, values in columns.items():
            file[f"run/{name}"] = values
        file["run/w1"].attrs["units"] = "rad/s"
        file["note"] = "a rig"
        file["other"] = np.zeros(7)


def mat_v73_file(path):
    """As MATLAB writes it: a header before the data, column vectors as one row."""
    hdf5_file(path, {k: v[None, :] for k, v in COLUMNS.items()}, userblock_size=512)
    with h5py.File(path, "r+") as file:
        for name in HEAD:
            file[f"run/{name}"].attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def mcap_file(path, fields=HEAD, logged=None):
    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("log", "jsonschema", b"{}")
        channel = writer.register_channel("/rig/log", "json", schema)
        for k in range(N):
            data = json.dumps({name: COLUMNS[name][k] for name in fields}).encode()
            at = int(STAMPS[k] if logged is None else logged[k])
            writer.add_message(channel, at, data, at)
        writer.finish()


ROS = """std_msgs/Header header
float64 w1
float64 w2
float64 q1
uint8[] image
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def ros_file(path):
    """Messages that were logged late and unevenly, with stamps that were not."""
    with open(path, "wb") as stream:
        writer = RosWriter(stream)
        schema = writer.register_msgdef("rig/msg/State", ROS)
        for k, ns in enumerate(STAMPS.tolist()):
            stamp = {"sec": ns // 10**9, "nanosec": ns % 10**9}
            message = {"header": {"stamp": stamp, "frame_id": "rig"}, "image": [0] * 99}
            message |= {name: float(COLUMNS[name][k]) for name in HEAD[1:]}
            writer.write_message("/rig/state", schema, message, ns + 10**6 * (k % 7))
        writer.finish()


def protobuf_file(path):
    described = descriptor_pb2.FileDescriptorProto(name="rig.proto", package="rig")
    kind = described.message_type.add(name="State")
    for number, name in enumerate(HEAD, 1):
        kind.field.add(name=name, number=number, type=1, label=1)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(described)
    State = message_factory.GetMessageClass(pool.FindMessageTypeByName("rig.State"))
    with open(path, "wb") as stream, ProtobufWriter(stream) as writer:
        for k in range(N):
            message = State(**{name: COLUMNS[name][k] for name in HEAD})
            writer.write_message("/rig", message, int(STAMPS[k]), int(STAMPS[k]))


def of_bytes(make):
    return lambda path: path.write_bytes(make())


FORMATS = {
    "log.csv": of_bytes(csv_bytes),
    "log.csv.gz": of_bytes(lambda: gzip.compress(csv_bytes())),
    "log.csv.zst": of_bytes(lambda: zstandard.compress(csv_bytes())),
    "log.parquet": lambda path: parquet.write_table(pa.table(COLUMNS), path),
    "pandas.parquet": lambda path: pd.DataFrame(COLUMNS).set_index("time_s").to_parquet(path),
    "log.feather": lambda path: feather.write_feather(pa.table(COLUMNS), str(path)),
    "plain.feather": lambda path: feather.write_feather(
        pa.table(COLUMNS), str(path), compression="uncompressed"
    ),
    "log.h5": hdf5_file,
    "matrix.h5": lambda path: hdf5_file(path, {"time_s": COLUMNS["time_s"], "w1": NUMBERS[:, 1],
                                               "x": NUMBERS[:, 2:]}),
    "v73.mat": mat_v73_file,
    "v5.mat": lambda path: savemat(path, {"log": COLUMNS, "rate": 50.0}),
    "v4.mat": lambda path: savemat(path, COLUMNS, format="4"),
    "log.npz": lambda path: np.savez(path, **COLUMNS, note="a rig"),
    "packed.npz": lambda path: np.savez_compressed(path, **COLUMNS),
    "log.npy": lambda path: np.save(path, pd.DataFrame(COLUMNS).to_records(index=False)),
    "log.jsonl": lambda path: pd.DataFrame(COLUMNS).to_json(
        path, orient="records", lines=True, double_precision=15
    ),
    "log.mcap": mcap_file,
    "logged.mcap": lambda path: mcap_file(path, HEAD[1:]),
    "ros.mcap": ros_file,
    "protobuf.mcap": protobuf_file,
}  # fmt: skip
NAMES = {"matrix.h5": {"state": ["w1", "run/x[0]"], "output": ["x[1]"]}}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_bits(tmp_path, name):
    path = tmp_path / name
    FORMATS[name](path)
    r = read(path, **COMMON | NAMES.get(name, {}))
    (x, y), = r.history.recordings  # fmt: skip
    T = round(HISTORY / 0.02)
    same = np.testing.assert_array_equal
    if name == "log.jsonl":  # 15 digits are not all of a float64
        same = lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)  # noqa: E731
    same(x, NUMBERS[: T + 1, 1:3])
    same(y, NUMBERS[:T, 3:])
    same(r.Y, NUMBERS[T:-1, 3:])
    same(r.x_true, NUMBERS[T + 1 :, 1:3])
    np.testing.assert_allclose(r.t[0], 3.02, rtol=1e-12)
    if name in ("logged.mcap",):
        assert r.stamps.tolist() == STAMPS[T + 1 :].tolist()
    if name == "ros.mcap":
        assert r.stamps[0] == f"{STAMPS[T + 1] // 10**9}.{STAMPS[T + 1] % 10**9:09d}"
    if name == "log.h5":
        assert r.history.x_units == ["rad/s", ""]


def frames():
    pandas = pd.DataFrame(COLUMNS)
    dates = pd.to_datetime(STAMPS)
    return {
        "pandas": pandas,
        "pandas, time as index": pandas.set_index("time_s"),
        "pandas, dates as index": pandas.drop(columns="time_s").set_index(dates),
        "pandas, dates with a zone": pandas.assign(time_s=dates.tz_localize("UTC")),
        "pandas, own types": pandas.convert_dtypes(),
        "pyarrow": pa.table(COLUMNS),
        "mapping": COLUMNS,
        "mapping of lists": {name: list(values) for name, values in COLUMNS.items()},
        "records": pandas.to_records(index=False),
    }


@pytest.mark.parametrize("name", frames())
def test_frames_are_read_as_files_are(name):
    r = read(frames()[name], **COMMON)
    np.testing.assert_array_equal(r.history.recordings[0][0], NUMBERS[:151, 1:3])
    np.testing.assert_array_equal(r.Y, NUMBERS[150:-1, 3:])
    np.testing.assert_allclose(r.t[0], 3.02, rtol=1e-12)
    if "dates" in name:
        assert np.asarray(r.stamps).astype("int64").tolist() == STAMPS[151:].tolist()


def test_frames_say_rows_where_files_say_lines():
    frame = pd.DataFrame(COLUMNS)
    frame.loc[[30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40], "w1"] = np.nan
    with pytest.raises(LogError, match="the DataFrame, row 31, column 'w1': expected at most 10"):
        read(frame, **COMMON)
    for wrong in (5, object(), np.zeros((9, 4)), pd.Series([1.0])):
        with pytest.raises(LogError, match="src: expected a path, a frame"):
            read(wrong, **COMMON)


def test_topics_with_other_stamps_are_joined_and_said(tmp_path):
    """States at twice the rate, 3 ms before the outputs: the latest before each output."""
    path = tmp_path / "two.mcap"
    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("log", "jsonschema", b"{}")
        truth, seen = (
            writer.register_channel(topic, "json", schema) for topic in ("/truth", "/seen")
        )
        for k in range(2 * N):
            at = int(STAMPS[0]) + 10**7 * k
            writer.add_message(truth, at - 3 * 10**6, json.dumps({"w": [k, -k]}).encode(), at)
            if k % 2 == 0:
                writer.add_message(seen, at, json.dumps({"q1": k}).encode(), at)
        writer.finish()
    r = read(path, state=["/truth.w[0]", "truth/w[1]"], output=["q1"], history=1.0)
    (x, y), = r.history.recordings  # fmt: skip
    np.testing.assert_array_equal(x, np.outer(np.arange(0, 102, 2), [1, -1]))
    np.testing.assert_array_equal(y[:, 0], np.arange(0, 100, 2))
    assert "/truth joined to the log times of /seen, the latest message before, at most 3 ms" in (
        "; ".join(r.notes)
    )
    with pytest.raises(LogError, match=r"expected a column of .*two.mcap, found 'w3'"):
        read(path, state=["w3"], output=["q1"], history=1.0)
    with pytest.raises(LogError, match=r"column '/seen.q1': expected at most 10 cells in a row"):
        read(path, state=["/seen.q1"], output=["/truth.w[0]"], history=1.0)


@pytest.mark.parametrize(
    ("name", "library"),
    [
        ("log.parquet", "pyarrow"),
        ("log.feather", "pyarrow"),
        ("log.h5", "h5py"),
        ("log.mcap", "mcap"),
        ("ros.mcap", "mcap_ros2"),
        ("protobuf.mcap", "mcap_protobuf"),
        ("log.csv.zst", "zstandard"),
    ],
)
def test_a_library_that_is_not_there_is_named_with_its_extra(tmp_path, monkeypatch, name, library):
    FORMATS[name](tmp_path / name)
    kept = builtins.__import__

    def without(module, *arguments, **named):
        if module.partition(".")[0] == library:
            raise ImportError(module)
        return kept(module, *arguments, **named)

    for module in list(sys.modules):
        if module.partition(".")[0] == library:
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(builtins, "__import__", without)
    monkeypatch.setattr(
        "ddmhe.recordings.libraries.import_module", lambda m: without(m, fromlist="x")
    )
    with pytest.raises(LogError, match=rf"{name}: .* needs {library}: pip install 'ddmhe\[logs\]'"):
        read(tmp_path / name, **COMMON)


def test_standard_input(tmp_path):
    for data in (csv_bytes(), zstandard.compress(csv_bytes())):
        result = subprocess.run(
            [sys.executable, "-m", "ddmhe", "estimate", "-", "--state", "w1,w2", "--output", "q1",
             "--history", "3"],
            input=data, capture_output=True, timeout=120,
        )  # fmt: skip
        assert (result.returncode, result.stderr.decode()) == (0, "")
        assert "standard input: time column 'time_s' in s" in result.stdout.decode()


def test_the_command_line_reads_parquet_as_csv(tmp_path):
    for name in ("log.csv", "log.parquet"):
        FORMATS[name](tmp_path / name)
        columns = ["--state", "w1,w2", "--output", "q1", "--history", 3]
        run = in_here("estimate", name, *columns, "--out", f"{name}.est.csv", cwd=tmp_path)
        assert run.returncode == 0, run.stderr
    csv, table = (tmp_path / f"{n}.est.csv" for n in ("log.csv", "log.parquet"))
    assert csv.read_bytes() == table.read_bytes()


def test_loading_the_package_loads_no_format():
    code = (
        "import sys, ddmhe.cli, ddmhe.recordings\n"
        "print({'pandas', 'pyarrow', 'h5py', 'mcap', 'scipy', 'zstandard'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("set()\n", "")


def test_a_packed_parquet_is_read_from_memory(tmp_path):
    stream = io.BytesIO()
    parquet.write_table(pa.table(COLUMNS), stream)
    path = tmp_path / "log.parquet.gz"
    path.write_bytes(gzip.compress(stream.getvalue()))
    np.testing.assert_array_equal(read(path, **COMMON).Y, NUMBERS[150:-1, 3:])
