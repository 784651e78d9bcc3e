"""One BLAS thread, the order of the suite, tests that depend on the clock, and shared fixtures."""

import gc
import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # read when NumPy is loaded; workers and commands inherit it

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402
from support.machine import Machine  # noqa: E402

import softrobot_env  # noqa: E402, F401  (registers the ids)
from softrobot_env.core import under_way  # noqa: E402
from softrobot_env.registration import ENVIRONMENTS  # noqa: E402

under_way.SPEAKS = False  # when depends on how busy the machine is

# ---------------------------------------------------------------- order and choice

#: Files that take longest without compiled kernels, in the order in which workers begin them. Those
#: that compile the same models stand apart, so that little is compiled twice.
FIRST = (
    "beams/test_beam_models.py",  # all three models
    "control/test_policy_contract.py",  # controllers
    "training/test_training.py",
    "commands/test_cli.py",
    "envs/test_plants.py",
    "beams/test_cosserat.py",
    "beams/test_pcc.py",
    "beams/test_integration.py",
    "control/scheduled/test_scheduled.py",
)

#: Where the durations of the last runs are kept, and what a quick test takes at most [s].
_DURATIONS, _QUICK = "softrobot/durations", 0.1


def pytest_addoption(parser):
    parser.addoption(
        "--quick",
        action="store_true",
        help=f"leave out tests that took more than {_QUICK:g} s in their last run; those that were "
        "never run are run",
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    root = config.rootpath / "tests"
    for name in FIRST:
        if not (root / name).is_file():
            raise pytest.UsageError(f"conftest.FIRST names {name}, which is no file")
    known = config.cache.get(_DURATIONS, {}) if config.getoption("quick") else {}
    slow = [item for item in items if known.get(item.nodeid, 0) > _QUICK]
    if slow:
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if known.get(item.nodeid, 0) <= _QUICK]

    def rank(item):
        name = item.path.relative_to(root).as_posix()
        clock = item.get_closest_marker("realtime") is not None
        return clock, FIRST.index(name) if name in FIRST else len(FIRST)

    items.sort(key=rank)  # stable: otherwise as they were collected


def pytest_collection_finish():
    """What is loaded by now stays: the collector need not look at it again and again."""
    gc.collect()
    gc.freeze()


class _Durations:
    """Keeps how long each test takes, its setup included, for `--quick`."""

    def __init__(self, config):
        self._config, self._found = config, {}

    def pytest_runtest_logreport(self, report):
        self._found[report.nodeid] = self._found.get(report.nodeid, 0.0) + report.duration

    def pytest_sessionfinish(self):
        known = self._config.cache.get(_DURATIONS, {})
        self._config.cache.set(_DURATIONS, known | self._found)


def pytest_configure(config):
    known = config.pluginmanager.has_plugin("cacheprovider")
    if known and not hasattr(config, "workerinput"):  # the workers' reports come here
        config.pluginmanager.register(_Durations(config))


# ---------------------------------------------------------------- tests that depend on the clock


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """A test marked `realtime` that fails while the machine was too busy for it is skipped.

    `@pytest.mark.realtime(late=0.02)` says how late [s] another process may be woken. This is
    measured beside the test by a process of its own, so a failure on a machine that gave what the
    test needs stays a failure, however slow the tested code is.
    """
    marker = item.get_closest_marker("realtime")
    if marker is None:
        return (yield)
    with Machine() as machine:
        try:
            return (yield)
        except Exception as error:
            worst, allowed = machine.worst(), marker.kwargs["late"]
            if worst <= allowed:
                raise
            pytest.skip(
                f"needs a machine that wakes processes within {1e3 * allowed:g} ms; this one took "
                f"{1e3 * worst:.0f} ms, and the test failed: {type(error).__name__}"
            )


# ---------------------------------------------------------------- fixtures


@pytest.fixture(params=ENVIRONMENTS)
def env_id(request):
    """Every registered id in turn."""
    return request.param


@pytest.fixture
def make_env():
    """Factory of bare environments (no wrappers); closes what it made.

    Tasks that are drawn anew for every episode keep that of seed 0, unless told otherwise.
    """
    made = []

    def make(env_id="SoftRobot/ArmSwing-v0", **kwargs):
        if env_id in ("SoftRobot/ArmRandom-v0", "SoftRobot/RigReach-v0") and "task" not in kwargs:
            kwargs = {"seed": 0} | kwargs
        env = gymnasium.make(env_id, **kwargs).unwrapped
        made.append(env)
        return env

    yield make
    for env in made:
        env.close()


@pytest.fixture
def hold_action():
    """Factory of the action that keeps the task's start input."""

    def action(env):
        return (np.array(env.task.start_input) / env.input_scale).astype(np.float32)

    return action


@pytest.fixture
def patience():
    """Patience with robots of a busy machine, for `pytest.mark.usefixtures("patience")`."""
    from support.patience import patient_drivers  # needs the robot extra

    with patient_drivers():
        yield
