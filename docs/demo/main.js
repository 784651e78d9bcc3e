// The page: simulates in real time, draws, and lets hands and networks drive.
import loadMujoco from "@mujoco/mujoco";
import { Scene } from "./drawing.js";
import { Robot } from "./robot.js";

const WHAT = {
  arm: "Half a metre of silicone with three pairs of tendons. A network of 30 neurons turns where the tip is and shall be into tensions, five times a second.",
  rig: "A spatial robot with three tendons, as it was identified. A network knows which lengths lead where; feedback of the tip adds what is missing.",
};
const MOST_BEHIND = 0.1; // s that are caught up after the page slept
const PUSH = { force: { arm: [0, 0, -1.5], rig: [1.0, 0.6, 0] }, lasts: 0.3 };

const $ = (id) => document.getElementById(id);
const mujoco = await loadMujoco();
const robots = (await (await fetch("robots.json")).json()).map((told) => new Robot(mujoco, told));
const scene = new Scene($("view"));
let robot, paused = false, pushedUntil = 0, last = performance.now(), ahead = 0;

function choose(which) {
  robot = which;
  scene.begin(robot);
  $("what").textContent = WHAT[robot.told.name];
  $("driven").checked = robot.driven;
  for (const tab of $("robots").children) tab.setAttribute("aria-selected", tab.textContent === robot.told.name);
  const scale = robot.told.unit === "m" ? 1000 : 1, unit = robot.told.unit === "m" ? "mm" : "N";
  const range = robot.model.actuator_ctrlrange;
  $("sliders").replaceChildren(...robot.controls.map((_, k) => {
    const line = document.createElement("label"), input = document.createElement("input");
    line.className = "slider";
    input.type = "range";
    const most = unit === "N" ? 30 : 25, least = unit === "N" ? Math.max(range[2 * k], 0) : -5;
    Object.assign(input, { min: least, max: most, step: 0.1 });
    input.addEventListener("input", () => {
      robot.driven = $("driven").checked = false;
      robot.controls[k] = input.value / scale;
    });
    const value = document.createElement("output");
    line.append(`tendon ${k + 1}`, input, value);
    line.show = () => {
      if (document.activeElement !== input || robot.driven) input.value = scale * robot.controls[k];
      value.textContent = `${(scale * robot.controls[k]).toFixed(1)} ${unit}`;
    };
    return line;
  }));
}

function advance(now) {
  ahead = Math.min(ahead + (now - last) / 1000, MOST_BEHIND);
  last = now;
  if (!paused) {
    robot.push(robot.time < pushedUntil ? PUSH.force[robot.told.name] : [0, 0, 0]);
    for (; ahead >= robot.timestep; ahead -= robot.timestep) robot.step();
    scene.remember(robot);
  }
  scene.draw(robot);
  for (const line of $("sliders").children) line.show();
  $("error").textContent = (1000 * robot.error).toFixed(1);
  $("state").textContent = `${robot.time.toFixed(1)} s; ${(1 / robot.timestep).toFixed(0)} timesteps a second`;
  requestAnimationFrame(advance);
}

$("robots").replaceChildren(...robots.map((one) => {
  const tab = document.createElement("button");
  tab.textContent = one.told.name;
  tab.setAttribute("role", "tab");
  tab.addEventListener("click", () => choose(one));
  return tab;
}));
$("driven").addEventListener("change", (event) => { robot.driven = event.target.checked; });
$("pause").addEventListener("click", () => {
  paused = !paused;
  $("pause").textContent = paused ? "Go on" : "Pause";
});
$("push").addEventListener("click", () => { pushedUntil = robot.time + PUSH.lasts; });
$("reset").addEventListener("click", () => {
  robot.reset();
  pushedUntil = 0;
  scene.begin(robot);
});
choose(robots.find((one) => `#${one.told.name}` === location.hash) ?? robots[0]);
requestAnimationFrame(advance);
