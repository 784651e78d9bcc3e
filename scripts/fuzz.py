"""Damaged input of every kind, by seed: it is read, or refused in a line; all else is a fault.

    python scripts/fuzz.py --times 10000            # every kind, as at night
    python scripts/fuzz.py robot frames --seed 3    # some of them, 500 times each

A sound file of a kind is written, damaged in one of its ways, and read. What is read holds no NaN,
what is refused names the file, and neither takes longer than a minute. The file of a fault is
kept in --out. Case K of a seed is always the same one.
"""

import argparse
import csv
import shutil
import signal
import sys
import tempfile
import tomllib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from softrobot_env import recordings
from softrobot_env.control.registry import make_policy
from softrobot_env.control.sensed import load_reconstruction
from softrobot_env.core.artifacts import read_arrays, read_facts
from softrobot_env.core.files import assets_dir, models_dir, text
from softrobot_env.core.records import placed
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.report import write_json
from softrobot_env.evaluation.rollout import _UNMEASURED, Rollout
from softrobot_env.evaluation.run import run_episode
from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.session import Session
from softrobot_env.hardware.robot_file import read_robot_file, virtual_file, write_robot_file
from softrobot_env.hardware.transport import LoggingTransport, read_link_log
from softrobot_env.identification.fit.residual import Residual, read_residual
from softrobot_env.learned.network import Network, Scaling, initial_network
from softrobot_env.learned.reduction import ReducedModel
from softrobot_env.recordings.header import Time
from softrobot_env.robots import ARM, RIG, ROBOTS, read_gripper, read_robot, write_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.resolution import ResolutionWarning
from softrobot_env.tasks import make_task
from softrobot_env.thesis.arm.operating_points import load_gains
from softrobot_env.thesis.rig.parameters import IdentifiedParameters

#: Longest that a case may take [s]: a robot that hardly stands takes a while to choose its pieces.
LONGEST = 60.0

#: How input is refused: in a line that names the file.
REFUSALS = (ValueError, OSError, RobotError)

# ---------------------------------------------------------------- ways of damage

#: What may stand in a text, and in a table, in place of a value.
_TEXTS = (b"nan", b"inf", b"-1", b"1e400", b'"x"', b"[]", b"{}", b"true", b"", b"\xff", b"0")
_VALUES: tuple[Any, ...] = (
    *(0, -1, 1, 10**30, 0.0, -0.0, 5e-324, 1e-9, 1e9, 1e308, np.nan, np.inf, -np.inf),
    *(True, "", "x", "a/b", "\x1b[2J", "\0", "9" * 999),
    *([], [[]], [1.0], [0.0, 0.0], [[0.0, 0.0, 0.0]], {}, {"x": 1}, [{}]),
)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Cut, overwritten in one to eight places, or with another value in a text."""
    how = rng.integers(3)
    if how == 0:
        return data[: rng.integers(len(data))]
    if how == 1:
        out = bytearray(data)
        for place in rng.integers(len(out), size=rng.integers(1, 9)):
            out[place] = rng.integers(256)
        return bytes(out)
    words = data.split(b" ")
    words[rng.integers(len(words))] = _TEXTS[rng.integers(len(_TEXTS))]
    return b" ".join(words)


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """A whole npz file of which one or two arrays are missing or something else."""
    arrays = dict(np.load(BytesIO(data), allow_pickle=False))
    count = min(len(arrays) - 1, rng.integers(1, 3))
    for name in map(str, rng.choice(list(arrays), size=max(count, 1), replace=False)):
        array = np.array(arrays[name])
        how = rng.integers(8)
        if how == 0 and array.dtype.kind == "f" and array.size:
            array.flat[rng.integers(array.size)] = rng.choice([np.nan, np.inf, -np.inf])
        elif how == 1:
            array = array[..., None]
        elif how == 2 and array.ndim:
            array = array[:-1]
        elif how == 3:
            array = array.astype("U9")
        elif how == 4:
            array = np.zeros(0)
        elif how == 5:
            array = np.float64(np.nan)
        elif how == 6 and array.dtype.kind in "fiu":
            array = array.astype(complex)
        elif how == 7 and len(arrays) > 1:
            arrays.pop(name, None)
            continue
        arrays[name] = array
    out = BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def retold(data: bytes, rng: np.random.Generator) -> bytes:
    """A whole TOML file of which one or two values are others, far smaller or larger, twice there
    or missing."""
    table = tomllib.loads(data.decode())
    for _ in range(rng.integers(1, 3)):
        places = list(_places(table))
        holder, key = places[rng.integers(len(places))]
        value, how = holder[key], rng.integers(6)
        if how < 3 and isinstance(value, int | float):
            holder[key] = float(value * 10.0 ** rng.normal(0, 3))
        elif how == 3:
            del holder[key]
        elif how == 4 and isinstance(holder, list):
            holder.append(deepcopy(value))
        else:
            holder[key] = deepcopy(_VALUES[rng.integers(len(_VALUES))])
    return text(table).encode()


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """All tables and lists within a value, each with every key."""
    keys = list(value) if isinstance(value, dict) else range(len(value))
    for key in keys:
        yield value, key
        if isinstance(value[key], dict | list):
            yield from _places(value[key])


def rewritten(data: bytes, rng: np.random.Generator) -> bytes:
    """A whole CSV file of which a cell is another, or a row, or a column."""
    rows = list(csv.reader(StringIO(data.decode())))
    row, column, how = rng.integers(len(rows)), rng.integers(len(rows[0])), rng.integers(4)
    if how == 0:
        del rows[row]
    elif how == 1:
        rows = [one[:column] + one[column + 1 :] for one in rows]
    elif how == 2:
        rows.insert(rng.integers(len(rows) + 1), rows[row])
    else:
        rows[row][column] = str(_VALUES[rng.integers(len(_VALUES))])
    out = StringIO()
    csv.writer(out).writerows(rows)
    return out.getvalue().encode("utf-8", "replace")


def forged(data: bytes, rng: np.random.Generator) -> bytes:
    """Frames of which some have other bytes in them, with their checksum right."""
    from cobs import cobs  # of the extra `robot`, which no other kind needs

    frames = [cobs.decode(frame)[:-4] for frame in data.split(b"\0") if frame]
    for k in rng.integers(len(frames), size=rng.integers(1, 4)):
        body = bytearray(frames[k])
        body[rng.integers(len(body))] = rng.choice([0, 1, 127, 128, 255, rng.integers(256)])
        frames[k] = bytes(body)
    return b"\0".join(cobs.encode(one + _checksum(one)) for one in frames) + b"\0"


def _checksum(body: bytes) -> bytes:
    return crc32(body, m.seed(body[1])).to_bytes(4, "little")


# ---------------------------------------------------------------- kinds of input


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    Attributes:
        file: Name of its file.
        write: Writes a sound one.
        read: Reads it.
        ways: In which it is damaged.
    """

    file: str
    write: Callable[[Path], Any]
    read: Callable[[Path], Any]
    ways: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (damaged,)


_MOVED = np.linspace(0.0, 1.0, 12)
SHORT_RECORDING = recordings.Recording(
    header=recordings.Header(
        commands=recordings.Commands("tension", ("a", "b"), "N", ("a", "b")),
        marker=(recordings.Marker("x", "y", "z"),),
        time=Time("t"),
        label="what",
    ),
    times=_MOVED,
    commands=np.stack([_MOVED, 1 - _MOVED], axis=1),
    markers=np.stack([_MOVED, _MOVED**2, 1 - _MOVED], axis=1)[:, None],
    labels=np.array(["go"] * 12),
    runs=np.zeros(12, dtype=int),
)
_LQI = 42  # gains a point


def _residual(path: Path) -> None:
    features, rows = np.linspace(1, 2, 3), np.linspace(0, 1, 12).reshape(4, 3)
    Residual(features, features, features[:1], 0.5, 1.0, rows, rows).save(path)


def _rollout(path: Path) -> None:
    """The record of a short motion."""
    env = TrackingEnv(replace(make_task("swing"), duration=0.1))
    run_episode(env, make_policy("hold", ARM, env.control_period)).save(path)


def _measured(path: Path) -> dict[str, Any]:
    """A record without what a real robot may have no sensor for."""
    found = vars(Rollout.load(path))
    return {name: value for name, value in found.items() if name not in _UNMEASURED}


def _shipped(path: Path) -> None:
    shutil.copy(models_dir() / path.name, path)


def _gripper(path: Path) -> None:
    for folder in (assets_dir() / "robots", assets_dir() / "grippers"):
        shutil.copytree(folder, path.parents[1] / folder.name, dirs_exist_ok=True)


def _facts(path: Path) -> None:
    write_json(path, [{"x": 1.5, "y": [k, 2e-3]} for k in range(300)], "softrobot x")


def _network(path: Path) -> None:
    ends = Scaling(-np.ones(20), np.ones(20))
    made = initial_network((200, 200), ends, ends, np.random.default_rng(0))
    made.save(path, {"seed": 1})


def _link(path: Path) -> None:
    """A recorded link: a header and a few records."""
    path.unlink(missing_ok=True)
    transport = LoggingTransport(_Quiet(), path, iter(range(99)).__next__)
    for k in range(8):
        transport.write(bytes(range(k + 3)))
    transport.close()


class _Quiet:
    """A transport that takes all and says nothing."""

    def write(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


def _recording(path: Path) -> None:
    """Tensions and tips of a short motion, and their header."""
    table = path.with_suffix(".csv") if path.suffix == ".toml" else path
    recordings.write_recording(SHORT_RECORDING, table)


def _scene(path: Path) -> list[np.ndarray]:
    """What `softrobot robot-file check` makes of a file."""
    robot = read_robot(path)
    with placed(path):
        model = build_scene(scene_of(robot)).model
    return [model.body_mass, model.body_inertia, model.jnt_stiffness, model.dof_damping]


_NONCE = 7


def _frames(path: Path) -> None:
    """What a board says that is asked who it is, configured, and read; and a fault."""
    robot = virtual_file()
    config = robot.to_message()
    every = m.Capability.LENGTH | m.Capability.FORCE | m.Capability.SUPPLY
    state = m.State(
        *(1000, 0, 0, int(m.DeviceState.DISARMED), config.n, 0, 0, 0),
        **dict.fromkeys(("applied", "length", "force"), (0,) * config.n),
        adc=(0,) * m.ADC_CHANNELS,
        vbus=6000,
        crc_errors=0,
        frame_errors=0,
    )
    said = [
        m.HelloAck(_NONCE, 1, 256, m.PROTOCOL, m.PROTOCOL, m.SCHEMA, config.n, int(every), 0),
        m.ConfigAck(crc32(m.pack(config, 0)[m.HEADER_SIZE :])),
        *(replace(state, t_dev=1000 * k) for k in range(1, 9)),
        m.Nack(m.Setpoint.number, 3, int(m.Reason.RANGE)),
        m.FaultReport(int(m.Fault.STALL), 1, -300, 9000),
        m.Pong(5, 9001),
    ]
    path.write_bytes(b"".join(m.encode(one, k) for k, one in enumerate(said)))


def _session(path: Path) -> list[Any]:
    """What a host makes of it, which still listens afterwards."""
    session = Session(virtual_file(), _NONCE)
    with placed(path):
        try:
            session.receive(path.read_bytes(), 1.0)
        except RobotError as error:
            raise ValueError(error) from None
        session.receive(b"\0" + m.encode(m.Pong(1, 2), 60000), 2.0)
    return list(map(vars, session.readings))


_TOML = (damaged, retold)
_NPZ = (damaged, altered)
KINDS = {
    "network": Kind("network.npz", _network, Network.load, _NPZ),
    "gains": Kind("lqi.npz", _shipped, lambda path: load_gains(path, ARM, "lqi", _LQI), _NPZ),
    "identified": Kind("rig_nn.npz", _shipped, partial(IdentifiedParameters.load, RIG), _NPZ),
    "rollout": Kind("a.npz", _rollout, _measured, _NPZ),
    "reduced": Kind("ssm.npz", _shipped, lambda path: ReducedModel.read(read_arrays(path)), _NPZ),
    "sensors": Kind("sensors.npz", _shipped, partial(load_reconstruction, RIG), _NPZ),
    "residual": Kind("residual.npz", _residual, read_residual, _NPZ),
    "robot": Kind("robot.toml", partial(write_robot, ROBOTS["hanging_trunk"]), _scene, _TOML),
    "rig": Kind("robot.toml", partial(write_robot, RIG), _scene, _TOML),
    "finger": Kind("robot.toml", partial(write_robot, ROBOTS["gripper_finger"]), _scene, _TOML),
    "gripper": Kind("grippers/gripper.toml", _gripper, read_gripper, _TOML),
    "hardware": Kind("rig.toml", partial(write_robot_file, virtual_file()), read_robot_file, _TOML),
    "link": Kind("a.link", _link, read_link_log),
    "frames": Kind("a.bin", _frames, _session, (damaged, forged)),
    "facts": Kind("a.json", _facts, read_facts),
    "recording.csv": Kind("a.csv", _recording, recordings.read_recording, (damaged, rewritten)),
    "recording.parquet": Kind("a.parquet", _recording, recordings.read_recording),
    "recording.toml": Kind("a.toml", _recording, recordings.read_header, _TOML),
}

# ---------------------------------------------------------------- cases


@dataclass(frozen=True)
class Fault:
    """What went wrong in a case, and the file that was read."""

    case: int
    what: str
    data: bytes


def finite(value: Any) -> bool:
    """Whether all floating numbers within are numbers; infinity may be a limit that is none."""
    if is_dataclass(value) and not isinstance(value, type):
        return all(finite(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, list | tuple | set):
        return all(map(finite, value))
    if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
        return not np.isnan(value).any()
    return not (isinstance(value, float) and np.isnan(value))


class _TooLongError(BaseException):
    pass


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Interrupt what computes for longer, or waits ten times as long: other programs may run."""

    def stop(*_: Any) -> None:
        raise _TooLongError(f"takes longer than {seconds:g} s")

    limits = {
        signal.SIGPROF: (signal.ITIMER_PROF, seconds),
        signal.SIGALRM: (signal.ITIMER_REAL, 10 * seconds),
    }
    before = {number: signal.signal(number, stop) for number in limits}
    for timer, most in limits.values():
        signal.setitimer(timer, most)
    try:
        yield
    finally:
        for number, (timer, _) in limits.items():
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])


def run(kind: Kind, folder: Path, times: int, seed: int = 1) -> tuple[int, list[Fault]]:
    """How many of the cases of a kind are refused, and the faults."""
    path = folder / kind.file
    path.parent.mkdir(parents=True, exist_ok=True)
    kind.write(path)
    data, refused, faults = path.read_bytes(), 0, []
    if not finite(kind.read(path)):
        raise AssertionError(f"the sound {kind.file} holds NaN")
    for case in range(times):
        rng = np.random.default_rng([seed, case])
        path.write_bytes(kind.ways[case % len(kind.ways)](data, rng))
        wrong = None
        try:
            with within(LONGEST), warnings.catch_warnings():
                warnings.simplefilter("ignore", ResolutionWarning)
                found = kind.read(path)
        except REFUSALS as error:
            refused += 1
            said = str(error)
            if "\n" in said or path.name not in said:
                wrong = f"refused without its file, or in several lines: {said!r}"
        except (Exception, _TooLongError) as error:  # whatever it is, it is a fault
            wrong = f"{type(error).__name__}: {error}"
        else:
            wrong = None if finite(found) else "what is read holds NaN"
        if wrong is not None:
            faults.append(Fault(case, wrong, path.read_bytes()))
    return refused, faults


def main() -> int:
    """Run kinds; 1 if there are faults."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"out of {', '.join(KINDS)}")
    parser.add_argument("--times", type=int, default=500, help="cases of a kind; default: 500")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="for files of faults")
    args = parser.parse_args()
    if unknown := set(args.kinds) - set(KINDS):
        parser.error(f"no kind {', '.join(unknown)}; choose from {', '.join(KINDS)}")
    total = 0
    for name in args.kinds or KINDS:
        with tempfile.TemporaryDirectory() as folder:
            refused, faults = run(KINDS[name], Path(folder), args.times, args.seed)
        total += len(faults)
        print(f"{name}: {args.times} cases, {refused} refused, {len(faults)} faults", flush=True)
        for fault in faults:
            kept = args.out / f"{name}_{args.seed}_{fault.case}{Path(KINDS[name].file).suffix}"
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(fault.data)
            print(f"  {kept}: {fault.what}", flush=True)
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main())
