"""`softrobot view`: an interactive viewer in a window or a browser, with actuator sliders."""

from argparse import Namespace
from contextlib import closing
from dataclasses import replace
from typing import Any

from softrobot_env.envs.rendering import RenderError, check_display
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import play
from softrobot_env.evaluation.runner import Case
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import visible
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.tendons import set_coefficient

from .arguments import port
from .cases import make_setup, one_case, one_task
from .output import say

EXAMPLE = """softrobot view --robot my.toml
  softrobot view --task swing --policy feedforward_pi
  softrobot view --robot planar_finger --web"""

_HELP = "Space pauses; double-click on a piece, then Ctrl and drag, pulls it"
_HOST = "127.0.0.1"


ARGUMENTS = """
    <robot> default: the task's
    <task>
    --policy POLICY  drives the robot; default: the sliders, one of them for the friction
        coefficient of tendons that rub
    --web  in a browser on this machine, without a display: MuJoCo's studio, which has no
        authentication (any local user can reach it)
    --port PORT  of --web; default: a free one from 8080 on
"""

KINDS = {"port": port}


def run(args: Namespace) -> int:
    """Run the command until the window is closed.

    Raises:
        ValueError: A policy together with --web.
        RenderError: There is no display.
    """
    setup = make_setup(args)
    if args.web:
        if args.policy is not None:
            raise ValueError("--policy goes with a window only, not with --web")
        _browse(scene_of(one_task(args, setup.robot).robot), args.port or 0)
        return 0
    try:
        check_display()
    except RenderError as error:
        raise RenderError(f"{error}: softrobot view --web shows the robot in a browser") from None
    case = one_case(args, setup, twin=False)
    setup.check([case])
    say(_HELP)
    with closing(setup.environment(case, render_mode="human").unwrapped) as env:
        if args.policy is None:
            _by_hand(env, case)
        else:
            _by_policy(env, case)
    return 0


def _by_hand(env: TrackingEnv, case: Case) -> None:
    """Drive the robot by the sliders."""
    window = env.open_window()  # before one without sliders is opened
    env.reset(options=case.reset_options)
    simulation = env.simulation
    window.controls[:] = env.command
    while window.is_open:
        window.push(simulation.data)
        env.command[:] = window.controls
        if window.coefficient is not None:
            set_coefficient(simulation.model, window.coefficient)
        if not simulation.advance():
            env.reset(options=case.reset_options)
        env.render()


def _by_policy(env: TrackingEnv, case: Case) -> None:
    """Drive the robot by a policy, episode by episode."""
    window, acting = env.open_window(), case.make_policy(env.control_period)
    while window.is_open:
        for _ in play(env, acting, options=case.reset_options):
            window.push(env.simulation.data)
            window.controls[:] = env.simulation.ctrl
            env.render()
            if not window.is_open:
                return


def _browse(config: Any, http_port: int) -> None:
    """Serve MuJoCo's studio to this machine only."""
    try:
        from mujoco.studio import app, launch_web, viewer_protocol, web_viewer
    except ImportError as error:
        raise ImportError(f"--web needs mujoco.studio, which this MuJoCo lacks: {error}") from None

    # MuJoCo itself would listen on every network, without authentication.
    bind = web_viewer.web_server.bind_public_socket
    web_viewer.web_server.bind_public_socket = lambda host, port=0: bind(_HOST, port)
    web_viewer._print_url_banner = lambda host, port: _tell(port)
    scene = build_scene(replace(visible(config), timestep=None, integrator="discrete"))
    setting = viewer_protocol.ViewerConfig(title=config.robot.name, gfx="web", http_port=http_port)
    launch_web.run(setting, model=scene.model, plugins=[app.App(), *app.SIM_PLUGINS])


def _tell(port: int) -> None:
    say(
        f"http://{_HOST}:{port}/ shows the robot; Ctrl-C ends it. It has no authentication: all "
        "programs of this machine, and pages open in its browsers, can reach it",
        soft_wrap=True,
    )
