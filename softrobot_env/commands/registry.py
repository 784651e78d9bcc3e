"""The commands of `softrobot`."""

from softrobot_env.core.registry import Registry

from . import (
    benchmark,
    evaluate,
    grip,
    identify,
    inspect,
    listing,
    recording,
    render,
    robot_file,
    train,
    tune,
    view,
    warm_up,
)
from .arguments import Command
from .robot import command as robot

#: Name -> command.
COMMANDS: Registry[Command] = Registry(
    "command",
    {
        "evaluate": (evaluate, "run policies on tasks; write report.json, report.md and plots"),
        "render": (render, "write a video of a policy on a task"),
        "view": (view, "show a robot alive, with sliders for its drives"),
        "grip": (grip, "close a gripper on a bar; write a video"),
        "benchmark": (benchmark, "measure accuracy and speed"),
        "train": (train, "make the trained artifacts that policies load"),
        "tune": (tune, "search for settings of a training by Ray Tune"),
        "inspect": (inspect, "print what a scene contains and what it leaves out"),
        "warm-up": (warm_up, "compile what is compiled at its first use, ahead of it"),
        "list": (listing, "print the robots, tasks, policies, environments there are"),
        "export": (robot_file.EXPORT, "write the MJCF of the registered scenes, or of a robot"),
        "robot-file": (robot_file, "check the file of a robot of your own"),
        "recording": (
            recording,
            "check tables of commands and markers, and replay them with any robot",
        ),
        "identify": (
            identify,
            "find a robot's parameters in a recording; write its file and a report",
        ),
        "robot": (robot, "find, calibrate, hold and stop a real robot, or run a virtual one"),
    },
)
