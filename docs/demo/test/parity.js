// The page's robots move as MuJoCo in Python moves them: node test/parity.js MOTIONS
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import loadMujoco from "@mujoco/mujoco";
import { Robot } from "../robot.js";

const LARGEST = 1e-9; // m

const mujoco = await loadMujoco();
const told = JSON.parse(readFileSync(new URL("../robots.json", import.meta.url)));
const motions = JSON.parse(readFileSync(process.argv[2]));
for (const [k, motion] of motions.entries()) {
  const robot = new Robot(mujoco, told[k]);
  let worst = 0, moved = 0;
  const first = robot.tip;
  for (const [row, tip] of motion.tips.entries()) {
    robot.step();
    worst = Math.max(worst, ...robot.tip.map((x, i) => Math.abs(x - tip[i])));
    moved = Math.max(moved, ...robot.tip.map((x, i) => Math.abs(x - first[i])));
    for (let i = 1; i < 50 && row < motion.tips.length - 1; i += 1) robot.step();
  }
  console.log(`${motion.name}: within ${worst.toExponential(1)} m of Python, moved ${(1e3 * moved).toFixed(0)} mm`);
  assert.ok(worst < LARGEST, `${motion.name} differs by ${worst} m`);
  assert.ok(moved > 0.05, `${motion.name} stands still`);
}
console.log(`${motions.length} passed, 0 failed`);
