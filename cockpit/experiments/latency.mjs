// Delays, frame rates and processor time of the cockpit with a rendered stereo pair.
//
//   npm run build && node experiments/latency.mjs [--seconds S] [--trials N]
//
// Delays are measured in the page: how old what it draws is, and how long after the stick moved it has a state in which the arm moves.

import { mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { parseArgs } from "node:util";
import { MOVING, ROOT, STOPPED, browser, launch, open, push, quantile, ready, sleep, takeControl, until } from "../tests/harness.mjs";

const { values: options } = parseArgs({
  options: { seconds: { type: "string", default: "60" }, trials: { type: "string", default: "100" } },
});
const [seconds, trials] = [Number(options.seconds), Number(options.trials)];
if (!(seconds >= 1) || !(Number.isInteger(trials) && trials >= 1)) {
  console.error(`--seconds ${options.seconds}, --trials ${options.trials}: must be at least 1`);
  process.exit(2);
}
/** Ticks of the processor times in /proc per second. */
const TICKS = 100;
const IMAGES = `
camera:
  ros__parameters:
    use_sim_time: true
    images:
      cameras: [camera]
      rate: 10.0
      camera: {baseline: 0.12, compressed: jpeg}
`;

/** Parent, name and processor time [s] of each process. */
function processes() {
  const found = new Map();
  for (const pid of readdirSync("/proc").filter((name) => /^\d+$/.test(name))) {
    try {
      const stat = readFileSync(`/proc/${pid}/stat`, "utf8");
      const end = stat.lastIndexOf(")");
      const fields = stat.slice(end + 2).split(" ");
      const arguments_ = readFileSync(`/proc/${pid}/cmdline`, "utf8").split("\0");
      found.set(Number(pid), { parent: Number(fields[1]), arguments: arguments_, time: (Number(fields[11]) + Number(fields[12])) / TICKS });
    } catch {
      // It has ended.
    }
  }
  return found;
}

/** Processor time of what this program started, by kind [s]. */
function used() {
  const all = processes();
  const totals = {};
  for (const [pid, { arguments: args, time }] of all) {
    let up = pid;
    while (up > 1 && up !== process.pid) up = all.get(up)?.parent ?? 0;
    if (up !== process.pid || pid === process.pid) continue;
    const kind = args[0].endsWith("fuyu") ? "fuyu (all nodes and the server)" : `browser: ${args.find((a) => a.startsWith("--type="))?.slice(7) ?? "main"}`;
    totals[kind] = (totals[kind] ?? 0) + time;
  }
  return totals;
}

/** Processor time of the threads of fuyu, by name [s]. */
function threads() {
  const totals = {};
  for (const [pid, { parent, arguments: args }] of processes()) {
    if (parent !== process.pid || !args[0].endsWith("fuyu")) continue;
    for (const id of readdirSync(`/proc/${pid}/task`)) {
      try {
        const stat = readFileSync(`/proc/${pid}/task/${id}/stat`, "utf8");
        const [from, to] = [stat.indexOf("("), stat.lastIndexOf(")")];
        const fields = stat.slice(to + 2).split(" ");
        const name = stat.slice(from + 1, to);
        totals[name] = (totals[name] ?? 0) + (Number(fields[11]) + Number(fields[12])) / TICKS;
      } catch {
        // It has ended.
      }
    }
  }
  return totals;
}

const shares = (before, now) =>
  Object.keys(now)
    .map((name) => [name, ((now[name] - (before[name] ?? 0)) / seconds) * 100])
    .filter(([, share]) => share >= 0.5)
    .sort((a, b) => b[1] - a[1]);

const folder = mkdtempSync(join(tmpdir(), "latency-"));
const config = join(folder, "cockpit.yaml");
writeFileSync(config, readFileSync(join(ROOT, "config/teleoperation.yaml"), "utf8") + IMAGES);
const chrome = await browser();
const run = await launch(config);
try {
  const page = await open(chrome.context, run.url);
  await ready(page);
  await takeControl(page);
  await until(page, "cockpit.images.stamps.left !== undefined");

  const motions = [];
  const stalls = () => page.evaluate(() => cockpit.operator.stalls);
  const before = await stalls();
  for (let i = 0; i < trials; i++) {
    await until(page, `${STOPPED} && !cockpit.operator.stalled`);
    await sleep(100 + 37 * (i % 7));
    const sign = i % 2 ? 0.8 : -0.8;
    const found = await page.evaluate(
      ([axes, moving]) =>
        new Promise((resolve) => {
          const holds = new Function(`return ${moving}`);
          setPad(axes, [0]);
          const start = performance.now();
          const timer = setInterval(() => {
            const waited = performance.now() - start;
            if (!holds() && waited < 5000) return;
            clearInterval(timer);
            resolve(waited);
          }, 1);
        }),
      [[sign, 0, 0, 0], MOVING],
    );
    await sleep(200);
    await page.evaluate(() => setPad([0, 0, 0, 0], []));
    motions.push(found);
  }
  const stalled = (await stalls()) - before;

  // Motion, so that there is something to draw.
  await until(page, STOPPED);
  await push(page, () => page.evaluate(() => setPad([-0.1, 0, 0, 0], [0])), () => page.evaluate(() => setPad([0, 0, 0, 0], [])));
  const [usedBefore, threadsBefore] = [used(), threads()];
  const seen = await page.evaluate(
    (seconds) =>
      new Promise((resolve) => {
        const [states, pictures, gaps] = [[], [], []];
        const start = performance.now();
        let [frames, images, last, previous] = [0, 0, cockpit.images.stamps.left, start];
        const frame = (now) => {
          frames += 1;
          gaps.push(now - previous);
          previous = now;
          states.push(1000 * cockpit.stateAge());
          pictures.push(1000 * cockpit.pictureAge());
          if (cockpit.images.stamps.left !== last) [last, images] = [cockpit.images.stamps.left, images + 1];
          if (now - start < 1000 * seconds) requestAnimationFrame(frame);
          else resolve({ states, pictures, gaps: gaps.slice(1), frames, images, trips: [...cockpit.operator.roundTrips] });
        };
        requestAnimationFrame(frame);
      }),
    seconds,
  );
  const [usedNow, threadsNow] = [used(), threads()];
  await page.evaluate(() => setPad([0, 0, 0, 0], []));

  console.log("| delay | p50 | p99 |\n| --- | ---: | ---: |");
  for (const [name, values] of [
    ["stick to motion seen in the page", motions],
    ["age of the state that is drawn", seen.states],
    ["age of the picture that is drawn, drawn anew until the next", seen.pictures],
    ["round trip of a service call", seen.trips],
    ["from one frame of the page to the next", seen.gaps],
  ]) {
    console.log(`| ${name} | ${quantile(values, 0.5).toFixed(1)} ms | ${quantile(values, 0.99).toFixed(1)} ms |`);
  }
  console.log(`\nframes of the page ${(seen.frames / seconds).toFixed(1)} /s, stereo pairs ${(seen.images / seconds).toFixed(1)} /s, ${motions.length} trials, stalls ${stalled}`);
  console.log("\n| process | share of a core |\n| --- | ---: |");
  for (const [name, share] of shares(usedBefore, usedNow)) console.log(`| ${name} | ${share.toFixed(1)} % |`);
  console.log("\n| thread of fuyu | share of a core |\n| --- | ---: |");
  for (const [name, share] of shares(threadsBefore, threadsNow)) console.log(`| ${name} | ${share.toFixed(1)} % |`);
  if (page.problems.length > 0) throw new Error(page.problems.join("\n"));
} finally {
  await run.stop();
  await chrome.close();
  rmSync(folder, { recursive: true, force: true });
}
