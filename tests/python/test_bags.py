"""Bags of ROS that are no MCAP: a database of ROS 2, a bag of ROS 1, by rosbags' own writers."""

import numpy as np
import pytest

rosbags = pytest.importorskip("rosbags")
from rosbags import rosbag1, rosbag2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

import ddmhe  # noqa: E402
from odd_logs import EPOCH, ROWS, N  # noqa: E402

VALUES = np.array([[float(cell) for cell in row] for row in ROWS])
STAMPS = EPOCH + 20_000_000 * np.arange(N)
COLUMNS = {
    "state": ["angular_velocity.x", "angular_velocity.y"],
    "output": ["linear_acceleration.z"],
    "history": 3.0,
}


def messages(store, kind):
    """An IMU of which three channels tell the log's numbers."""
    types = store.types
    Imu, Vector, Quaternion = (
        types[f"{package}/msg/{name}"]
        for package, name in (
            ("sensor_msgs", "Imu"), ("geometry_msgs", "Vector3"), ("geometry_msgs", "Quaternion")
        )
    )  # fmt: skip
    Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    nine = np.zeros(9)
    for k, ns in enumerate(STAMPS.tolist()):
        stamp = Time(sec=ns // 10**9, nanosec=ns % 10**9)
        counted = {"seq": k} if kind == 1 else {}
        yield ns, Imu(
            Header(**counted, stamp=stamp, frame_id="rig"),
            Quaternion(0.0, 0.0, 0.0, 1.0), nine,
            Vector(VALUES[k, 1], VALUES[k, 2], 0.0), nine,
            Vector(0.0, 0.0, VALUES[k, 3]), nine,
        )  # fmt: skip


def database(path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(path, version=8) as writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for ns, message in messages(store, 2):
            data = store.serialize_cdr(message, "sensor_msgs/msg/Imu")
            writer.write(connection, ns + 1_000_000, data)
    return path


def first_bag(path):
    store = get_typestore(Stores.ROS1_NOETIC)
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for ns, message in messages(store, 1):
            data = store.serialize_ros1(message, "sensor_msgs/msg/Imu")
            writer.write(connection, ns + 1_000_000, data)
    return path


def check(r):
    T = r.history.T
    (x, y), = r.history.recordings  # fmt: skip
    np.testing.assert_array_equal(x, VALUES[: T + 1, 1:3])
    np.testing.assert_array_equal(np.vstack([y, r.Y]), VALUES[:-1, 3:])
    np.testing.assert_array_equal(np.asarray(r.x_true), VALUES[T + 1 :, 1:3])


def test_a_folder_with_a_database(tmp_path):
    folder = database(tmp_path / "bag")
    check(ddmhe.recordings.read(folder, **COLUMNS))
    (alone,) = folder.glob("*.db3")
    r = ddmhe.recordings.read(alone, **COLUMNS)
    check(r)
    assert any("/imu.angular_velocity.x" in note for note in r.notes)


def test_a_bag_of_ros_1(tmp_path):
    check(ddmhe.recordings.read(first_bag(tmp_path / "log.bag"), **COLUMNS))


def test_a_column_that_a_bag_lacks(tmp_path):
    wrong = COLUMNS | {"output": ["pressure"]}
    with pytest.raises(ddmhe.DdmheError, match="found 'pressure'"):
        ddmhe.recordings.read(database(tmp_path / "bag"), **wrong)
