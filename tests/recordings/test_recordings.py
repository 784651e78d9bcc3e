"""Recordings in files: what is read has SI units and the robot's frame; what is wrong is named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.bad_files import assert_refused
from support.recorded_rods import real_recording

from softrobot_env.core.files import assets_dir
from softrobot_env.recordings import (
    Frame,
    Marker,
    Recording,
    read_header,
    read_recording,
    write_recording,
)
from softrobot_env.recordings.columns import read_parquet, write_columns
from softrobot_env.recordings.files import header_path
from softrobot_env.recordings.recording import summarize
from softrobot_env.robots import ROBOTS

TABLE = """\
# by hand
stamp,what,s1,s2,right,up
1700000000000,circle,10,1,100,20
1700000000500,circle_hold,20,2,110,21
1700000000750,line,30,3,120,22
"""

HEADER = """\
static = true
label = "what"
label_ends = ["_hold"]

[time]
column = "stamp"
unit = "ms"

[commands]
kind = "length"
unit = "mm"
columns = ["s2", "s1"]
tendons = ["b", "a"]
factors = [-1, 1]

[[marker]]
x = "right"
z = "up"
unit = "cm"

[frame]
axes = ["z", "x", "y"]
shift_m = [0.5, 0, 0]
"""


def write_pair(folder, table=TABLE, header=HEADER) -> Path:
    path = folder / "a.csv"
    path.write_text(table)
    header_path(path).write_text(header)
    return path


def test_units_factors_and_frame_are_applied(tmp_path):
    recording = read_recording(write_pair(tmp_path))
    assert recording.times == pytest.approx([0, 0.5, 0.75])
    assert recording.commands == pytest.approx(1e-3 * np.array([[-1, 10], [-2, 20], [-3, 30]]))
    # The world's x, y and z are the recorded z, x and y; nobody measured the recorded y.
    (first, *_), *_ = recording.markers
    assert first[:2] == pytest.approx([0.2 + 0.5, 1.0]) and np.isnan(first[2])
    assert recording.patterns.tolist() == ["circle", "circle", "line"]
    assert recording.tendons == ("b", "a") and recording.static


def test_angles_of_servos_are_lengths_by_their_spools(tmp_path):
    header = HEADER.replace('unit = "mm"', 'unit = "deg"\nspool_radius_m = 0.02')
    recording = read_recording(write_pair(tmp_path, header=header))
    turned = np.radians([[-1, 10], [-2, 20], [-3, 30]])
    assert recording.commands == pytest.approx(0.02 * turned)
    write_recording(recording, tmp_path / "b.csv")
    assert read_recording(tmp_path / "b.csv").commands == pytest.approx(recording.commands)


def test_a_table_may_be_parted_by_semicolons_or_tabs_and_have_decimal_commas(tmp_path):
    usual = read_recording(write_pair(tmp_path))
    comma = TABLE.replace(",", ";").replace("100;20", "1,00e2;20,0")
    for table in (comma, TABLE.replace(",", "\t")):
        recording = read_recording(write_pair(tmp_path, table))
        assert np.array_equal(recording.markers, usual.markers, equal_nan=True)
        assert np.array_equal(recording.commands, usual.commands)


def test_rows_at_rest_need_no_times(tmp_path):
    time = '[time]\ncolumn = "stamp"\nunit = "ms"\n'
    untimed = HEADER.replace(time, "")
    assert read_recording(write_pair(tmp_path, header=untimed)).times.tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match=r"give a table \[time\] or rate_Hz"):
        read_recording(write_pair(tmp_path, header=untimed.replace("true", "false")))


def test_commands_are_put_in_the_order_of_the_robots_tendons(tmp_path):
    rod = ROBOTS["silicone_rod"]
    names = rod.tendon_names
    recording = read_recording(write_pair(tmp_path))
    head = recording.header

    def driving(tendons):
        commands = replace(head.commands, tendons=tendons)
        return replace(recording, header=replace(head, commands=commands))

    controls = driving((names[2], names[0])).controls(rod)
    assert controls[0] == pytest.approx([0.01, 0.0, -0.001])
    for tendons, said in (
        (None, "which tendons the commands drive is not known.*one of a1"),
        (("a1", "other"), "has no tendon 'other'; it has a1, a2, a3"),
    ):
        with pytest.raises(ValueError, match=said):
            driving(tendons).controls(rod)


@pytest.mark.parametrize(
    ("where", "old", "new", "said"),
    [
        ("table", "right,up", "left,up", "column 'right' is missing; there are stamp, what"),
        ("table", ",110,", ",,", "row 2: column 'right' must be a number.*needs may_be_lost"),
        ("table", ",110,", ",nan,", "row 2: column 'right' must be finite, got nan"),
        ("table", ",3,120", ",inf,120", "row 3: column 's2' must be finite"),
        ("table", "0750", "0400", "row 3: times must rise, got 0.4 s after 0.5 s"),
        ("table", ",120,22", ",120", "row 3 has 5 columns instead of 6"),
        ("table", TABLE[TABLE.index("17") :], "", "no rows below the names"),
        ("table", TABLE, "", "the file is empty"),
        ("header", 'unit = "mm"', 'unit = "inch"', "unit of a length must be one of m, cm, mm"),
        ("header", 'unit = "mm"', 'unit = "deg"', "go together, got unit 'deg' and none"),
        ("header", "factors", "spool_radius_m = 0.01\nfactors", "got unit 'mm' and one"),
        ("header", 'unit = "cm"', 'unit = "inch"', r"marker\[1\].unit must be one of 'm', 'cm'"),
        ("header", '"ms"', '"h"', "time.unit must be one of 's', 'ms', 'us', 'ns', got 'h'"),
        ("header", '"length"', '"angle"', "kind must be one of 'length', 'tension', 'action'"),
        ("header", '["b", "a"]', '["b"]', "tendons must be one for each of the 2 columns, got 1"),
        ("header", '["b", "a"]', '["b", "b"]', "different names, 'b' is there more than once"),
        ("header", "shift_m", "shift", "frame.shift is no key; allowed are axes, turn_deg"),
        ("header", '["z", "x", "y"]', '["x", "z", "y"]', "axes x, z, y are left-handed"),
        ("header", '["z", "x", "y"]', '["x", "x", "y"]', "axes must be x, y and z"),
        ("header", "[time]", "[clock]", "clock is no key"),
        ("header", 'kind = "length"\n', "", "commands: kind missing"),
        ("header", "static = true", "static = maybe", "no TOML"),
        ("header", "[0.5, 0, 0]", "[0.5, 0, 0]\nturn_deg = [0, 0, 9]", "a turn needs markers with"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(tmp_path, where, old, new, said):
    table = write_pair(tmp_path)
    path = table if where == "table" else header_path(table)
    assert_refused(lambda _: read_recording(table), path, old, new, said)


def test_files_that_are_missing_or_of_another_kind(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_recording(tmp_path / "none.csv")
    path = write_pair(tmp_path)
    header_path(path).unlink()
    with pytest.raises(FileNotFoundError, match=r"has no header: write a\.toml beside it"):
        read_recording(path)
    other = path.rename(tmp_path / "a.xls")
    header_path(other).write_text(HEADER)
    with pytest.raises(ValueError, match=r"are \.csv, \.parquet, \.mcap"):
        read_recording(other)


def test_a_header_given_counts_before_the_one_beside_the_table(tmp_path):
    path, given = write_pair(tmp_path), tmp_path / "found.toml"
    given.write_text('[commands]\ntendons = ["c", "d"]\n')
    head = read_recording(path, given).header
    assert head.commands.tendons == ("c", "d") and head.commands.factors == (-1, 1)
    with pytest.raises(ValueError, match=r"found\.toml: commands: kind, columns, unit missing"):
        read_header(given)


def test_names_of_columns_that_are_no_text_are_refused(tmp_path):
    pytest.importorskip("pyarrow")
    path = tmp_path / "a.parquet"
    write_columns({"é": np.zeros(2)}, path)
    path.write_bytes(path.read_bytes().replace("é".encode(), b"\x87\x87"))
    with pytest.raises(ValueError, match=r"a\.parquet: no Parquet file, or damaged"):
        read_parquet(path)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_written_is_read_again(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    head = replace(
        read_header(Path(write_pair(tmp_path)).with_suffix(".toml")),
        frame=Frame(("y", "z", "x"), (10, -20, 30), (0.1, 0.2, 0.3)),
        marker=(Marker("x", "y", "z", "mm", 0.1, (0, 0, 0.01), 0.02), Marker("a", "b", "c")),
        runs="run",
        rate_Hz=None,
    )
    rng = np.random.default_rng(0)
    recording = Recording(
        head,
        np.array([0.0, 0.02, 0.0, 0.05]),
        0.01 * rng.standard_normal((4, 2)),
        0.1 * rng.standard_normal((4, 2, 3)),
        np.array(["a", "b, c", "", 'd"']),
        np.array([0, 0, 1, 1]),
    )
    path = tmp_path / "new" / f"b{suffix}"
    write_recording(recording, path)
    again = read_recording(path)
    assert again.header == head and again.labels.tolist() == recording.labels.tolist()
    for name in ("times", "commands", "markers", "runs"):
        assert getattr(again, name) == pytest.approx(getattr(recording, name), rel=1e-7, abs=1e-9)
    assert {file.name for file in path.parent.iterdir()} == {f"b{suffix}", "b.toml"}


def test_a_frame_turns_as_rotation_vectors_do():
    vector = np.array([20.0, -35.0, 80.0])
    frame = Frame(("-y", "x", "z"), tuple(vector), (1, 2, 3))
    points = np.random.default_rng(1).standard_normal((5, 3))
    swapped = np.stack([-points[:, 1], points[:, 0], points[:, 2]], axis=1)
    wanted = Rotation.from_rotvec(np.radians(vector)).apply(swapped) + np.array([1, 2, 3])
    assert frame.to_world(points) == pytest.approx(wanted)
    assert frame.to_recorded(wanted) == pytest.approx(points)


def test_what_is_odd_is_reported(tmp_path):
    table = TABLE + "".join(f"{1700000001000 + 250 * k},line,30,3,120,22\n" for k in range(3))
    table += "1700000009000,line,30,3,90000,22\n"
    recording = read_recording(write_pair(tmp_path, table))
    summary = summarize(recording, ROBOTS["silicone_rod"])
    assert summary.rate == pytest.approx(4) and summary.gaps == (7,)
    assert summary.longest_gap == pytest.approx(7.5) and summary.patterns == {
        "circle": 2,
        "line": 5,
    }
    far, unfit = summary.warnings
    assert "marker 1 is up to 9e+05 mm" in far and "no tendon 'b'" in unfit
    still = summarize(recording.part(slice(2, 6)))
    assert still.warnings == (
        "command s2 never changes",
        "command s1 never changes",
        "marker 1 never moves",
    )


def test_the_motion_capture_of_a_real_robot():
    path = real_recording("ftdcr_v4/train.csv")
    recording = read_recording(path, assets_dir() / "recordings" / "ftdcr_v4.toml")
    summary = summarize(recording, ROBOTS["ftdcr_v4"])
    assert (summary.rows, len(summary.patterns), recording.commands.shape[1]) == (1620, 66, 9)
    # Nitinol does not stretch: the tip stays within the robot's reach, up to the marker's offset.
    assert np.linalg.norm(recording.markers[:, 0], axis=1).max() < 1.05 * 0.1865
    (unknown,) = summary.warnings
    assert "which tendons the commands drive is not known" in unknown


def test_a_marker_may_be_lost_where_the_header_says_so(tmp_path):
    seen = HEADER.replace('x = "right"\n', 'x = "right"\ny = "far"\nmay_be_lost = true\n')
    seen = seen.replace("shift_m = [0.5, 0, 0]", "turn_deg = [0, 0, 30]")
    whole = TABLE.replace("up\n", "up,far\n").splitlines()
    whole = "\n".join([*whole[:2], *(f"{line},5" for line in whole[2:])])
    table = whole.replace(",110,21", ",,nan")
    recording = read_recording(write_pair(tmp_path, table, seen))
    lost = np.isnan(recording.markers[:, 0])
    assert lost[1].all() and not lost[[0, 2]].any()
    assert "marker 1 is lost in 1 of 3 rows" in summarize(recording).warnings
    write_recording(recording, tmp_path / "b.csv")
    again = read_recording(tmp_path / "b.csv")
    assert again.markers == pytest.approx(recording.markers, abs=1e-9, nan_ok=True)
    with pytest.raises(ValueError, match="row 1: column 'right' must be finite, got inf"):
        read_recording(write_pair(tmp_path, whole.replace(",100,", ",inf,"), seen))


def test_rows_at_rest_may_have_one_time_and_others_not(tmp_path):
    table = TABLE.replace("0750", "0500")
    assert read_recording(write_pair(tmp_path, table)).times.tolist() == [0, 0.5, 0.5]
    with pytest.raises(ValueError, match=r"row 3: times must rise, got 0\.5 s after 0\.5 s"):
        read_recording(write_pair(tmp_path, table, HEADER.replace("static = true\n", "")))
