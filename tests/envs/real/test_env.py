"""The real rig's environment against a virtual robot in a process of its own."""

import signal
import subprocess
import time
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from support.processes import python
from support.real_episodes import PATIENT

from softrobot_env.commands.robot.soak import unsafe_outputs
from softrobot_env.commands.robot.virtual import virtual_process
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.hardware.errors import RobotFaultError
from softrobot_env.robots import RIG
from softrobot_env.tasks import Task
from softrobot_env.thesis.envs import RigEnv
from softrobot_env.thesis.trajectories import RoundedTriangle

pytest.importorskip("serial", reason="needs the robot extra")
pytest.importorskip("cobs", reason="needs the robot extra")

pytestmark = [pytest.mark.realtime(late=0.8), pytest.mark.usefixtures("patience")]

TWIN = 1

PATIENT_FILE = {"watchdog": 0.9, "ttl": 0.8}

#: Lateness [s] with which a step still follows the one before as on a quiet machine.
PROMPT = 5e-3

#: A lap of 5 s and the way to it, quicker than that of the registered task.
RUN = RoundedTriangle(b1=0.05, period=3.0, laps=0, approach=2.0)
TASK = Task("triangle", RIG, RUN, 6.0, (0.0, 0.0, 0.0), axes="xy")


@pytest.fixture(scope="module")
def robot():
    with virtual_process(TWIN) as running:
        yield running._replace(file=replace(running.file, **PATIENT_FILE))


@pytest.fixture
def make(robot):
    made = []

    def make_env(task=TASK, **options):
        own = {"robot_file": robot.file, "tip": robot.tip} | PATIENT
        env = RealRigEnv(task, **own | options)
        made.append(env)
        return env

    yield make_env
    for env in made:
        env.close()


def begin(env, **options):
    """Start an episode, whatever the test before has left behind."""
    return env.reset(options={"clear_fault": True} | options)


def still():
    return np.zeros(3, dtype=np.float32)


def test_an_episode_takes_its_time_by_the_clock(make):
    env = make()
    begin(env, duration=1.0)
    over, count, since, missed = False, 0, None, 0
    while not over:
        before = count + missed
        *_, terminated, over, info = env.step(still())
        missed = info["missed_steps"]
        since = time.monotonic() if count == 0 else since
        count += 1
    assert time.monotonic() - since > 0.9
    # The first step arms the robot, the last one ramps it down.
    assert not terminated and info["time"] == pytest.approx(1.0)
    assert before < 50 <= count + missed
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(still())
    env.reset()
    assert env.step(still())[4]["device_state"] == "running"


def answered(info):
    """Whether a step was called in time, and answered in its period."""
    return not np.isnan(info["rtt_s"]) and info["lateness_s"] < PROMPT


def test_info_tells_of_link_and_age(make, robot):
    env = make()
    begin(env)
    # Two steps in time, the first of them answered in its period; on a busy machine not all are.
    # Without one before, a measurement that the robot sends anyway, every 50 ms until then, may
    # answer a set-point at once.
    steps = pairwise(env.step(still())[4] for _ in range(200))
    info = next(info for before, info in steps if answered(before) and answered(info))
    assert info["fault"] == "" and info["limited"] is False
    assert 0 <= info["obs_age_s"] < PATIENT["oldest"] and 0.01 < info["tip_age"] < PATIENT["oldest"]
    assert robot.file.state_delay <= info["rtt_s"] < PATIENT_FILE["ttl"]
    assert info["link_crc_errors"] == info["link_frame_errors"] == 0
    assert info["applied_action"] == pytest.approx(np.zeros(3), abs=1e-3)


def test_actions_beyond_the_calibrated_range_are_limited_and_reported(make, robot):
    servos = tuple(replace(servo, maximum=0.002) for servo in robot.file.tendons)
    env = make(robot_file=replace(robot.file, tendons=servos))
    begin(env)
    for action in (np.full(3, np.nan), np.zeros(2), np.full(3, 1.5)):
        with pytest.raises(ValueError, match="array of 3 numbers"):
            env.step(action)
    pull = np.array([0.2, 0.0, 0.0], dtype=np.float32)
    for _ in range(15):
        *_, info = env.step(pull)
    assert info["limited"] is True
    assert env.length_scale * info["applied_action"] == pytest.approx([0.002, 0, 0], abs=1e-6)


def test_an_exception_in_a_step_is_an_emergency_stop(make, monkeypatch):
    env = make()
    begin(env)
    env.step(still())
    with monkeypatch.context() as patched:
        patched.setattr(env._clock, "finish", lambda: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            env.step(still())
    with pytest.raises(RobotFaultError, match="emergency"):
        env.reset()
    env.reset(options={"clear_fault": True})
    assert env.step(still())[4]["device_state"] == "running"


def test_a_pause_longer_than_the_watchdog_is_a_fault(make, robot):
    env = make()
    begin(env)
    env.step(still())
    time.sleep(2.5 * robot.file.watchdog)
    *_, terminated, truncated, info = env.step(still())
    assert truncated and not terminated
    assert "set-point" in info["failure"] and info["fault"] == info["failure"]
    for call in (lambda: env.step(still()), env.reset):
        with pytest.raises(RobotFaultError):
            call()
    env.reset(options={"clear_fault": True})


class Freezing:
    """The tip source, until it is frozen."""

    def __init__(self, source):
        self._source, self.frozen = source, None

    def latest(self, adc, time):
        return self.frozen or self._source.latest(adc, time)


def test_a_dead_tip_source_ends_the_episode(make, robot):
    source = Freezing(robot.tip)
    env = make(tip=source, oldest=1.0)
    begin(env)
    env.step(still())
    source.frozen = robot.tip.latest(None, 0.0)
    ends = (env.step(still()) for _ in range(200))
    *_, truncated, info = next(end for end in ends if end[3])
    assert truncated and "tip source" in info["failure"] and "old" in info["failure"]


def test_a_policy_does_the_same_in_simulation_and_over_the_wire(make):
    """Same twin, same policy: tips differ by less than a millimetre on average.

    A policy that is late is another policy: this needs a machine that gets every step done in time.
    """
    env = make()
    rollouts = []
    begin(env)
    for one in (env, RigEnv(TASK, twin=TWIN, observe="all")):
        policy = make_policy("hybrid", RIG, 0.02)
        rollouts.append(run_episode(one, policy, seed=0, options={"duration": 3.0}))
    real, simulated = rollouts
    assert (real.source, simulated.source) == ("real", "sim")
    assert real.failure is None
    place = np.stack([np.interp(real.time, simulated.time, x) for x in simulated.tip.T], axis=1)
    apart = np.linalg.norm(real.tip - place, axis=1)
    if env._missed > 3 and apart.mean() >= 1e-3:
        pytest.skip(f"the machine is too busy: {env._missed} of 150 steps were missed")
    assert apart.mean() < 1e-3
    assert np.ptp(real.tip[:, 0]) > 0.05  # it moved


HOST = f"""
import signal, sys, time
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
import numpy as np
from softrobot_env.hardware.errors import UnansweredError
from softrobot_env.hardware.robot_file import rig_file
from softrobot_env.hardware.driver import Driver
from softrobot_env.hardware.transport import SerialTransport

# Where tests run in the background, Ctrl-C is ignored, also by their children.
signal.signal(signal.SIGINT, signal.default_int_handler)
file = replace(rig_file(sys.argv[1]), **{PATIENT_FILE})
driver = Driver(file, SerialTransport(file.port, file.baud))
driver.connect(20)
driver.arm(20)
start, seq = time.monotonic(), 0
while True:
    since = time.monotonic() - start
    with suppress(UnansweredError):
        seq = driver.command(np.array([0.008 * since, 0.0, 0.0]).clip(0, 0.02))
    driver.wait_for(seq, time.monotonic() + 0.06)
    if since > 1.0:
        print("moving", flush=True)
"""


@contextmanager
def moving(port):
    """A host that moves the robot at a port, in a process of its own."""
    with python(HOST, port, text=True, stdout=subprocess.PIPE) as host:
        assert host.stdout.readline() == "moving\n"
        yield host


@pytest.mark.slow  # the watchdog itself is tested above and in tests/hardware
@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_killing_the_host_leaves_the_robot_at_rest(tmp_path, kill):
    log = tmp_path / "log.npz"
    with virtual_process(TWIN, log=log) as robot, moving(robot.file.port) as host:
        killed = time.monotonic()
        host.send_signal(kill)
        host.wait(30)
        file = replace(robot.file, **PATIENT_FILE)
        time.sleep(file.watchdog + 0.02 / file.ramp + 0.3)
    with np.load(log) as data:
        moment, applied, powered = data["time"], data["applied"], data["powered"]
        assert unsafe_outputs(dict(data), file)["unsafe_outputs"] == 0
    assert powered[moment < killed][-1]
    farthest = applied[moment < killed, 0].max()
    after = applied[moment > killed + file.watchdog + 0.05, 0]
    # From then on it only goes back to rest, and stays there without power.
    assert np.all(np.diff(after) <= 0) and after[0] <= farthest + 0.1 * 0.008 + 1e-3
    assert after[-1] == 0.0 and not powered[-1]
