"""MCAP files and Minari data sets as recordings; skipped where their packages are not there."""

import json
import sys
from io import BytesIO

import gymnasium
import numpy as np
import pytest

from softrobot_env.recordings import Commands, Header, Marker, Time, read_recording

TIPS = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]])
SERVOS = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])


@pytest.fixture
def mcap_header():
    return Header(
        commands=Commands("length", ("/servos.pulled.0", "/servos.pulled.1"), "mm"),
        marker=(Marker(x="/tip.point.x", z="/tip.point.z", unit="mm"),),
        time=Time("log_time", "ns"),
    )


def json_file(path, encoding="json"):
    """Servos speak 5 ms before each picture of the tip but the first, which nobody can use."""
    writer = pytest.importorskip("mcap.writer").Writer(stream := BytesIO())
    writer.start()
    schema = writer.register_schema("any", "jsonschema", b"{}")
    channels = {
        topic: writer.register_channel(topic, encoding, schema) for topic in ("/tip", "/servos")
    }

    def say(topic, milliseconds, message):
        time = 1_700_000_000_000_000_000 + milliseconds * 1_000_000
        writer.add_message(channels[topic], time, json.dumps(message).encode(), time)

    say("/tip", 0, {"point": {"x": 9.0, "z": 9.0}})
    for k, ((x, z), pulled) in enumerate(zip(TIPS, SERVOS, strict=True)):
        say("/servos", 15 + 20 * k, {"pulled": pulled.tolist(), "name": "rig"})
        say("/tip", 20 + 20 * k, {"point": {"x": x, "z": z}})
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


def ros_file(path):
    """The same as messages of ROS 2."""
    ros = pytest.importorskip("mcap_ros2.writer")
    with path.open("wb") as file:
        writer = ros.Writer(file)
        servos = writer.register_msgdef("x/Servos", "float64[] pulled")
        point = "x/Point point\n===\nMSG: x/Point\nfloat64 x\nfloat64 z"
        tip = writer.register_msgdef("x/Tip", point)
        for k, ((x, z), pulled) in enumerate(zip(TIPS, SERVOS, strict=True)):
            at = 1_700_000_000_000_000_000 + 20_000_000 * k
            writer.write_message("/servos", servos, {"pulled": pulled.tolist()}, at)
            writer.write_message("/tip", tip, {"point": {"x": x, "z": z}}, at + 1)
        writer.finish()
    return path


@pytest.mark.parametrize("write", [json_file, ros_file])
def test_a_row_is_a_picture_with_the_last_command_before(write, tmp_path, mcap_header):
    recording = read_recording(write(tmp_path / "a.mcap"), mcap_header)
    assert recording.times == pytest.approx([0.0, 0.02, 0.04])
    assert recording.commands == pytest.approx(1e-3 * SERVOS)
    assert recording.markers[:, 0, ::2] == pytest.approx(1e-3 * TIPS)
    assert np.isnan(recording.markers[:, 0, 1]).all()


def test_what_cannot_be_read_of_mcap_is_named(tmp_path, mcap_header):
    pytest.importorskip("mcap")
    with pytest.raises(ValueError, match="messages of /tip are 'xml'"):
        read_recording(json_file(tmp_path / "x.mcap", "xml"), mcap_header)
    other = Header(commands=Commands("length", ("/wheels.0",), "mm"), time=Time("log_time", "ns"))
    with pytest.raises(ValueError, match="the topics /wheels; there are /servos, /tip"):
        read_recording(json_file(tmp_path / "b.mcap"), other)
    (tmp_path / "c.mcap").write_bytes(b"no MCAP at all")
    with pytest.raises(ValueError, match=r"c\.mcap: no MCAP file"):
        read_recording(tmp_path / "c.mcap", mcap_header)


@pytest.mark.parametrize("data_format", ["arrow", "hdf5"])
def test_a_minari_data_set(tmp_path, monkeypatch, data_format):
    minari = pytest.importorskip("minari")
    pytest.importorskip({"arrow": "pyarrow", "hdf5": "h5py"}[data_format])
    from minari.data_collector import EpisodeBuffer

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    space = gymnasium.spaces.Box(-9, 9, (2,), np.float64)
    buffer = [
        EpisodeBuffer(
            id=k,
            observations={"tip": list(TIPS + k)},
            actions=list(SERVOS[:2] + k),
            rewards=[0.0, 0.0],
            terminations=[False, False],
            truncations=[False, True],
        )
        for k in range(2)
    ]
    with pytest.warns(UserWarning):
        minari.create_dataset_from_buffers(
            "rod/test-v0",
            buffer,
            action_space=space,
            observation_space=gymnasium.spaces.Dict({"tip": space}),
            data_format=data_format,
        )
    header = Header(
        commands=Commands("action", ("action.0", "action.1"), "1"),
        marker=(Marker(x="observation.tip.0", z="observation.tip.1"),),
        rate_Hz=50,
        runs="episode",
    )
    recording = read_recording(tmp_path / "rod" / "test-v0", header)
    assert recording.runs.tolist() == [0, 0, 0, 1, 1, 1]
    assert recording.times == pytest.approx([0, 0.02, 0.04] * 2)
    assert recording.commands[:3] == pytest.approx(SERVOS[[0, 1, 1]])
    assert recording.markers[3:, 0, ::2] == pytest.approx(TIPS + 1)
    with pytest.raises(ValueError, match="no Minari data set"):
        read_recording(tmp_path, header)


@pytest.mark.parametrize(
    ("package", "name"), [("pyarrow", "a.parquet"), ("mcap", "a.mcap"), ("minari", "folder")]
)
def test_a_package_that_is_missing_is_named(tmp_path, monkeypatch, mcap_header, package, name):
    for module in [module for module in sys.modules if module.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    path = tmp_path / name
    path.mkdir() if name == "folder" else path.write_bytes(b"")
    with pytest.raises(ImportError, match=rf"need {package}: pip install .*{package}"):
        read_recording(path, mcap_header)
