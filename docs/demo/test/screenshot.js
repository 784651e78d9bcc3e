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
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
const page = await browser.newPage({ viewport: { width: 1200, height: 760 } });
const wrong = [];
page.on("pageerror", (error) => wrong.push(String(error)));
page.on("request", (request) => {
  if (!request.url().startsWith(`http://localhost:${server.address().port}/`)) wrong.push(request.url());
});

const error = async () => Number(await page.textContent("#error"));
for (const name of ["arm", "rig"]) {
  await page.goto("about:blank");
  await page.goto(`http://localhost:${server.address().port}/#${name}`);
  await page.waitForFunction(() => /^[4-9]/.test(document.getElementById("state").textContent), null, { timeout: 60000 });
  await page.screenshot({ path: join(process.argv[2], `${name}.png`) });
  assert.ok((await error()) < 20, `${name} is ${await error()} mm from its reference`);
  const before = await page.locator("canvas").screenshot();
  await page.waitForTimeout(500);
  assert.ok(!before.equals(await page.locator("canvas").screenshot()), `${name} stands still`);
}
// By hand: the reference goes on without the tip.
const slider = page.locator(".slider input").first();
await slider.fill("20");
assert.equal(await page.locator("#driven").isChecked(), false);
await page.waitForTimeout(1500);
console.log(`by hand: ${await error()} mm`);
assert.ok((await error()) > 10, `by hand the tip is ${await error()} mm from its reference`);
await page.screenshot({ path: join(process.argv[2], "by_hand.png") });

await browser.close();
server.close();
assert.deepEqual(wrong, []);
console.log("2 passed, 0 failed");
