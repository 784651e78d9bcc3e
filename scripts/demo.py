"""Write what the page in docs/demo simulates, and the motion that its test compares it with.

    python scripts/demo.py                      # docs/demo/robots.json
    python scripts/demo.py --check              # says whether that is stale
    python scripts/demo.py --motions FILE       # the same robots, simulated here

Both robots are MJCF that MuJoCo simulates alone. Networks are those of the thesis that are shipped:
of the arm the local inverse of the statics (`qs_nn`, sec. 6.3), of the rig that of places with
feedback (`rig_nn_pi`, sec. 5.1), for the rig as it was identified.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.files import models_dir, write_text
from softrobot_env.learned.network import Network
from softrobot_env.robots import ARM, RIG
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.build import scene_xml
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.registry import SCENES
from softrobot_env.tasks import Task, make_task
from softrobot_env.thesis.rig.parameters import IdentifiedParameters

PAGE = Path(__file__).resolve().parents[1] / "docs" / "demo"
PERIOD = 0.01  # s, between points of a reference
SETTLE = 8.0  # s, in which a robot comes to rest where its reference begins
COMPARED = 20.0  # s, in which both robots go once along all of their references

#: Feedback of the rig's network, proportional [1] and integral [1/s], and the limit [m] of both.
FEEDBACK = {"proportional": 0.2, "integral": 1.5, "limit": 0.04}


def layers(network: Network) -> dict[str, Any]:
    """A network as the page reads it."""
    scale = {"inputs": network.inputs, "outputs": network.outputs}
    ends = {name: [s.low.tolist(), s.high.tolist()] for name, s in scale.items()}
    weights = [w.tolist() for w in network.weights]
    return {"weights": weights, "biases": [b.tolist() for b in network.biases], **ends}


def sampled(task: Task, begin: float, end: float, axes: str, haste: float = 1.0) -> ndarray:
    """The reference (n, 2) [m] from a time to another [s], gone through `haste` times as fast."""
    times = np.arange(begin, end - haste * PERIOD / 2, haste * PERIOD)
    points = np.array([task.trajectory.position(t) for t in times]).reshape(len(times), 3)
    return points[:, ["xyz".index(axis) for axis in axes]].round(6)


def body(name: str, config: SceneConfig, axes: list[int]) -> dict[str, Any]:
    """A robot without what moves it; tendons by offset from the axis and station of the end [m]."""
    robot = config.robot
    tendons = [{"offset": list(t.offset), "end": t.end} for t in robot.tendons]
    sizes = {"length": robot.length, "radius": robot.backbone.widest, "tendons": tendons}
    return {"name": name, "xml": scene_xml(config), "axes": axes, **sizes}


def arm() -> dict[str, Any]:
    """The arm, there and back on the swing."""
    task = make_task("swing")
    there = sampled(task, 0.0, task.trajectory.end_time, "xz")
    inputs = TendonMap(ARM)
    pulls = inputs.tension(np.eye(inputs.n_inputs)) - inputs.tension(-np.eye(inputs.n_inputs))
    network = Network.load(models_dir() / "qs_nn.npz")[0]
    return body("arm", SCENES["arm"], [0, 2]) | {
        "reference": {"approach": [], "lap": np.vstack([there, there[::-1]]).tolist()},
        "start": inputs.tension(np.array(task.start_input)).tolist(),
        "unit": "N",
        "network": {"kind": "local inverse", "every": 0.2, **layers(network)},
        "input": list(task.start_input),
        "pulls": pulls.tolist(),
    }


def rig() -> dict[str, Any]:
    """The rig as it was identified, on the triangle."""
    task, identified = make_task("triangle"), IdentifiedParameters.load(RIG)
    lead, period = task.trajectory.approach, task.trajectory.period
    laps = lead + 2 * period  # at full speed; the tip sets out at rest after the approach
    scene = replace(SCENES["rig"], robot=identified.believed(SCENES["rig"].robot))
    return body("rig", scene, [0, 1]) | {
        "reference": {
            "approach": np.vstack(
                [sampled(task, 0.0, lead, "xy", haste=4.0), sampled(task, lead, laps, "xy")]
            ).tolist(),
            "lap": sampled(task, laps, laps + period, "xy").tolist(),
        },
        "start": identified.network(np.zeros((1, 2)))[0].tolist(),
        "unit": "m",
        "network": {"kind": "places", "every": 0.02, **layers(identified.network), **FEEDBACK},
    }


class Moving:
    """A robot of the page, simulated here; `docs/demo/robot.js` does the same in the browser."""

    def __init__(self, page: dict[str, Any]) -> None:
        self.page, self.network = page, page["network"]
        self.model = mujoco.MjModel.from_xml_string(page["xml"])
        self.data = mujoco.MjData(self.model)
        self.every = round(self.network["every"] / self.model.opt.timestep)
        self.input, self.integral = np.array(page.get("input", [])), np.zeros(2)
        self.data.ctrl[:] = page["start"]
        while self.data.time < SETTLE:
            mujoco.mj_step(self.model, self.data)
        self.begun, self.steps = self.data.time, 0

    def reference(self, time: float) -> ndarray:
        """Point (2,) [m] at a time [s], between those that are given."""
        approach, lap = (np.array(self.page["reference"][x]) for x in ("approach", "lap"))
        at = time / PERIOD
        below = int(np.floor(at))

        def point(k: int) -> ndarray:
            return approach[k] if k < len(approach) else lap[(k - len(approach)) % len(lap)]

        return point(below) + (at - below) * (point(below + 1) - point(below))

    def evaluated(self, values: ndarray) -> ndarray:
        """Outputs of the network."""
        (low, high), (least, most) = (np.array(self.network[x]) for x in ("inputs", "outputs"))
        values = 2 * (values - low) / (high - low) - 1
        *hidden, last = zip(self.network["weights"], self.network["biases"], strict=True)
        for weights, biases in hidden:
            values = np.tanh(np.array(weights) @ values + biases)
        values = np.array(last[0]) @ values + last[1]
        return least + (values + 1) / 2 * (most - least)

    def decide(self) -> None:
        """Set tensions or lengths."""
        time, every = self.data.time - self.begun, self.network["every"]
        tip = self.data.sensordata[self.page["axes"]]
        if self.network["kind"] == "places":
            error, limit = self.reference(time) - tip, self.network["limit"]
            moved = self.integral + self.network["integral"] * every * error
            self.integral = np.clip(moved, -limit, limit)
            shift = np.clip(self.network["proportional"] * error + self.integral, -limit, limit)
            self.data.ctrl[:] = self.evaluated(self.reference(time) + shift)
            return
        given = np.concatenate([tip, self.reference(time + every), self.input])
        pulls = np.array(self.page["pulls"])
        self.input = self.evaluated(given)
        self.data.ctrl[:] = np.maximum(self.input @ pulls, 0.0)

    def step(self) -> None:
        """A timestep, and a decision before it where one is due."""
        if self.steps % self.every == 0:
            self.decide()
        self.steps += 1
        mujoco.mj_step(self.model, self.data)


def motions(robots: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Tips and errors [m] of the robots, every tenth of a second."""
    out = []
    for page in robots:
        moving, tips, off = Moving(page), [], []
        for _ in range(round(COMPARED / moving.model.opt.timestep)):
            moving.step()
            tip = moving.data.sensordata[:3]
            place = moving.reference(moving.data.time - moving.begun)
            off.append(float(np.linalg.norm(tip[page["axes"]] - place)))
            tips.append(tip.tolist())
        out.append({"name": page["name"], "tips": tips[::50], "largest": max(off[len(off) // 2 :])})
    return out


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="say whether the page is stale")
    parser.add_argument("--motions", type=Path, metavar="FILE", help="simulate, and write motions")
    args = parser.parse_args()
    robots = [arm(), rig()]
    text, path = json.dumps(robots) + "\n", PAGE / "robots.json"
    if args.motions is not None:
        found = motions(robots)
        write_text(args.motions, json.dumps(found))
        for one in found:
            print(f"{one['name']}: errs by {1e3 * one['largest']:.1f} mm at most")
    elif not args.check:
        write_text(path, text)
    elif path.read_text() != text:
        print(f"{path} is stale: python scripts/demo.py", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
