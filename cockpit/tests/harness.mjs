// Runs fuyu and a browser for the tests.

import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, rmSync } from "node:fs";
import net from "node:net";
import { tmpdir } from "node:os";
import { delimiter, join } from "node:path";
import { createInterface } from "node:readline";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

export const ROOT = fileURLToPath(new URL("../..", import.meta.url));
/** What a shared machine may need for what takes milliseconds [ms]. */
export const PATIENCE = 60_000;

export const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Starts `fuyu launch --cockpit`; the page's address, with its token. */
export async function launch(config = "config/teleoperation.yaml") {
  const folder = mkdtempSync(join(tmpdir(), "cockpit-"));
  const program = process.env.FUYU ?? join(ROOT, "target/release/fuyu");
  const args = ["launch", config, "--cockpit", "--foxglove=127.0.0.1:0", "--bag", join(folder, "bag")];
  const env = { ...process.env, ROS_DOMAIN_ID: process.env.ROS_DOMAIN_ID ?? "113" };
  const child = spawn(program, args, { cwd: ROOT, env, stdio: ["ignore", "pipe", "pipe"] });
  const log = [];
  createInterface({ input: child.stderr }).on("line", (line) => log.push(line));
  const url = await new Promise((resolve, reject) => {
    createInterface({ input: child.stdout }).on("line", (line) => {
      if (line.startsWith("cockpit: ")) resolve(line.slice("cockpit: ".length).trim());
    });
    child.on("exit", (code) => reject(new Error(`fuyu ended with ${code}: ${log.join("\n")}`)));
    child.on("error", reject);
  });
  const ended = new Promise((resolve) => child.on("exit", (code, signal) => resolve(code ?? signal)));
  return {
    url,
    log,
    ended,
    kill: () => child.kill("SIGKILL"),
    async stop() {
      child.kill("SIGINT");
      const code = await Promise.race([ended, sleep(PATIENCE).then(() => "still running")]);
      rmSync(folder, { recursive: true, force: true });
      return code;
    },
  };
}

/** The browser: that of the environment variable CHROMIUM, or the first that is installed. */
function executable() {
  if (process.env.CHROMIUM) return process.env.CHROMIUM;
  const folders = (process.env.PATH ?? "").split(delimiter);
  const names = ["chromium", "chromium-browser", "google-chrome"];
  const found = names.flatMap((name) => folders.map((folder) => join(folder, name))).find((path) => existsSync(path));
  if (!found) throw new Error(`none of ${names.join(", ")} is installed; CHROMIUM may name a browser`);
  return found;
}

/** Starts Chromium with an empty profile. */
export async function browser() {
  const folder = mkdtempSync(join(tmpdir(), "chromium-"));
  const context = await chromium.launchPersistentContext(folder, {
    executablePath: executable(),
    headless: true,
    viewport: { width: 1100, height: 800 },
    args: [
      "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
      "--disable-component-update", "--disable-sync", "--disable-background-timer-throttling",
      "--disable-backgrounding-occluded-windows", "--disable-renderer-backgrounding",
      "--host-resolver-rules=MAP evil.test 127.0.0.1",
    ],
  });
  // A gamepad whose sticks and buttons are set by the test.
  await context.addInitScript(() => {
    const pad = {
      connected: true, id: "virtual gamepad", index: 0, mapping: "standard", axes: [0, 0, 0, 0],
      buttons: Array.from({ length: 17 }, () => ({ pressed: false, touched: false, value: 0 })),
    };
    window.setPad = (axes, pressed) => {
      pad.axes = axes;
      pad.buttons.forEach((button, i) => {
        button.pressed = pressed.includes(i);
        button.value = button.pressed ? 1 : 0;
      });
    };
    navigator.getGamepads = () => [pad];
  });
  return {
    context,
    async close() {
      await context.close();
      rmSync(folder, { recursive: true, force: true });
    },
  };
}

/** Opens the page; errors of its scripts are collected. */
export async function open(context, url) {
  const page = await context.newPage();
  page.problems = [];
  page.on("pageerror", (error) => page.problems.push(String(error)));
  page.on("console", (message) => message.type() === "error" && page.problems.push(message.text()));
  await page.goto(url);
  return page;
}

/** Waits until the page shows a robot. */
export async function ready(page) {
  await page.waitForFunction(() => window.cockpit?.tip() && window.cockpit.world.baseFrame, undefined, { timeout: PATIENCE });
}

/** Takes control. */
export async function takeControl(page) {
  await page.waitForFunction(() => !document.getElementById("control").disabled, undefined, { timeout: PATIENCE });
  // Parameters say which axes the joystick has.
  await page.waitForFunction(() => window.cockpit.parameters.values.size > 20, undefined, { timeout: PATIENCE });
  await page.click("#control");
  await page.waitForFunction(() => window.cockpit.operator.hasControl, undefined, { timeout: PATIENCE });
}

/** Time until `condition` holds in the page, which may be a string [ms]. */
export async function until(page, condition, timeout = PATIENCE) {
  return page.evaluate(
    ([condition, timeout]) =>
      new Promise((resolve, reject) => {
        const holds = new Function(`return ${condition}`);
        const start = performance.now();
        const timer = setInterval(() => {
          const waited = performance.now() - start;
          if (!holds() && waited < timeout) return;
          clearInterval(timer);
          if (holds()) resolve(waited);
          else reject(new Error(`after ${timeout} ms: not ${condition}`));
        }, 2);
      }),
    [condition, timeout],
  );
}

/** Whether the arm moves, by the joint rates that a page receives [rad/s]. */
export const MOVING = "Math.max(...cockpit.rates().map(Math.abs)) > 2e-4";
/** The servo of the joints needs 0.07 s to half the speed, and half a second to rest. */
export const SLOWED = "Math.max(...cockpit.rates().map(Math.abs)) < window.speed / 2";
export const STOPPED = "Math.max(...cockpit.rates().map(Math.abs)) < 2e-4";

/** Presses until the arm moves. A stall on a busy machine disarms the page, as it should; only then it is pressed again. */
export async function push(page, press, release, observer = page) {
  for (let attempt = 0; attempt < 10; attempt++) {
    const stalls = await page.evaluate(() => cockpit.operator.stalls);
    await press();
    const moves = await until(observer, MOVING, 5000).then(() => true, () => false);
    if (moves) return;
    await release();
    if ((await page.evaluate(() => cockpit.operator.stalls)) === stalls) throw new Error("the arm does not move");
    console.log("REPEATED: the machine was so busy that the page saw a stall");
    await sleep(500);
  }
  throw new Error("the page saw a stall ten times");
}

/** A connection between browser and server that can be interrupted. */
export async function proxy(url) {
  const target = new URL(url);
  let open = true;
  const sockets = new Set();
  const server = net.createServer((client) => {
    const upstream = net.connect(Number(target.port), target.hostname);
    for (const [from, to] of [[client, upstream], [upstream, client]]) {
      sockets.add(from);
      from.on("error", () => {});
      from.on("close", () => to.destroy());
      from.on("data", (data) => to.write(data));
      if (!open) from.pause();
    }
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const address = new URL(url);
  address.port = String(server.address().port);
  return {
    url: address.href,
    stall() {
      open = false;
      for (const socket of sockets) socket.pause();
    },
    resume() {
      open = true;
      for (const socket of sockets) socket.resume();
    },
    close() {
      for (const socket of sockets) socket.destroy();
      server.close();
    },
  };
}

/** The given fraction of values is below this one. */
export function quantile(values, fraction) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(fraction * sorted.length))];
}
