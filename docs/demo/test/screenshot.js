// The page loads and moves in headless Chromium: node test/screenshot.js FOLDER
import assert from "node:assert/strict";
import { existsSync } from "node:fs";
import { join } from "node:path";
import { chromium } from "playwright-core";
import { serve } from "../server.js";

const BROWSERS = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
const executablePath = process.env.CHROMIUM ?? BROWSERS.find(existsSync);
if (!executablePath) {
  console.log("skipped: no Chromium; install one, or name it by CHROMIUM=/path");
  process.exit(0);
}

const server = await serve(0);
// Names of other machines are not found: the page needs no network.
const args = ["--no-sandbox", "--disable-quic", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE localhost"];
const browser = await chromium.launch({ executablePath, args });
const page = await browser.newPage({ viewport: { width: 1200, height: 760 } });
const wrong = [];
page.on("pageerror", (error) => wrong.push(String(error)));
page.on("request", (request) => {
  if (!request.url().startsWith(`http://localhost:${server.address().port}/`)) wrong.push(request.url());
});

const LAP = { arm: 8, rig: 17 }; // s, when the robot is on its reference at full speed
const error = async () => Number(await page.textContent("#error"));
const drawn = () => page.locator("canvas").screenshot();
const reached = (time) => page.waitForFunction(
  (least) => parseFloat(document.getElementById("state").textContent) >= least, time, { timeout: 60000 });
for (const [name, time] of Object.entries(LAP)) {
  await page.goto("about:blank");
  await page.goto(`http://localhost:${server.address().port}/#${name}`);
  await reached(time);
  await page.screenshot({ path: join(process.argv[2], `demo_${name}.png`) });
  assert.ok((await error()) < 20, `${name} is ${await error()} mm from its reference`);
  const before = await drawn();
  await page.waitForTimeout(500);
  assert.ok(!before.equals(await drawn()), `${name} stands still`);
  // By hand: the reference goes on without the tip.
  await page.locator(".slider input").first().fill("20");
  assert.equal(await page.locator("#driven").isChecked(), false);
  await page.waitForFunction(() => Number(document.getElementById("error").textContent) > 10, null, { timeout: 10000 });
  assert.match(await page.locator(".slider output").first().textContent(), /^20\.0 /);
  console.log(`${name} by hand: ${await error()} mm from its reference`);
  await page.screenshot({ path: join(process.argv[2], `demo_${name}_by_hand.png`) });
}
await page.locator("#pause").click();
const paused = await page.textContent("#state");
await page.waitForTimeout(300);
assert.equal(await page.textContent("#state"), paused, "the pause does not hold");
await page.locator("#reset").click();
assert.ok(parseFloat(await page.textContent("#state")) < 1, "it does not start again");

await browser.close();
server.close();
assert.deepEqual(wrong, []);
console.log("2 passed, 0 failed");
