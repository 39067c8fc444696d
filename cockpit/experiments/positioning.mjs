// The positioning experiment of Masutani 1995 chapter 8 through the page: a modelled operator looks at what the page shows and
// moves a gamepad, against the graph in real time.
//
//   npm run build && node experiments/positioning.mjs [--targets N] [--json FILE]
//
// For each method and delay of commands the operator brings the tip to targets half a metre away. Delays are repeated with the
// predictive display. `fuyu reproduce masutani-fig-8.7` is the same experiment without graph, page and delay.

import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { parseArgs } from "node:util";
import { ROOT, STOPPED, browser, launch, open, ready, sleep, takeControl, until } from "../tests/harness.mjs";

/** Section 8.3: the tip at the start in the base frame [m], distance of the targets [m], full speed [m/s]. */
const START = [0, 2.5, 1.5];
const DISTANCE = 0.5;
const FULL_SPEED = 0.5;
/** Joint positions with the tip at START [rad]. */
const POSTURE = [0, 2.33590443, -2.45751142];
/** As in src/experiments/masutani_ch8.rs: arrived if the tip stays so near [m] for so long [s]. */
const ARRIVED = 0.01;
const SETTLED = 3;
const LONGEST = 90;
/** The operator: a crossover model with a reaction time [s], images at an interval [s], and the crossover frequency that was
 * fitted to the six means of Fig. 8.7 [rad/s]. */
const REACTION = 0.25;
const IMAGE_PERIOD = 0.1;
const CROSSOVER = 0.8;
/** A person slows down when motion is seen late: crossover frequency times time delay is at most this [rad], which leaves a phase
 * margin of 60 degrees. */
const LARGEST_LAG = Math.PI / 6;

/** Methods with the mean and standard deviation of the times in the table below Fig. 8.7, floating base [s]. */
const METHODS = {
  inverse_generalized: [4.7, 1.44],
  inverse_fixed_base: [4.65, 1.8],
  transpose_generalized: [5.54, 2.74],
  transpose_fixed_base: [5.39, 1.75],
};
/** Added delay of commands [s], and whether the page draws the commanded tip. */
const CONDITIONS = [
  { delay: 0, predictive: false },
  { delay: 0.5, predictive: false },
  { delay: 0.5, predictive: true },
  { delay: 2, predictive: false },
  { delay: 2, predictive: true },
];

const { values: options } = parseArgs({
  options: { targets: { type: "string", default: "8" }, json: { type: "string" } },
});
const count = Number(options.targets);
if (!Number.isInteger(count) || count < 1 || count > 8) {
  console.error(`--targets ${options.targets}: must be 1 to 8`);
  process.exit(2);
}

/** Displacements of the targets from the tip at the start: corners of a cube [m]. */
const targets = Array.from({ length: count }, (_, i) => [0, 1, 2].map((bit) => ((i >> bit) & 1 ? DISTANCE : -DISTANCE) / Math.sqrt(3)));

/** The servicer without its wrist, as in chapter 7: three joints for three coordinates. */
function arm() {
  const [kept] = readFileSync(join(ROOT, "urdf/servicer.urdf"), "utf8").split('<joint name="joint4"');
  return `${kept}<joint name="tool0_joint" type="fixed"><parent link="link3"/><child link="tool0"/><origin xyz="2.5 0 0"/></joint><link name="tool0"/></robot>`;
}

function scenario(folder) {
  const urdf = join(folder, "arm.urdf");
  writeFileSync(urdf, arm());
  const config = join(folder, "positioning.yaml");
  writeFileSync(
    config,
    `dynamics:
  ros__parameters:
    urdf: ${urdf}
    initial_joint_positions: [${POSTURE.map((q) => q.toFixed(8)).join(", ")}]
    time_step: 0.01
    start_on_command: true
    velocity_servo: {bandwidth: 20.0}
teleop:
  ros__parameters:
    use_sim_time: true
    tip_link: tool0
    frame: base
    components: [vx, vy, vz]
    max_linear_speed: ${(2 * FULL_SPEED).toFixed(1)}
recorder:
  ros__parameters:
    use_sim_time: true
`,
  );
  return config;
}

/** Runs in the page: an operator who sees the base's camera's image and moves the gamepad. */
function installOperator({ reaction, imagePeriod }) {
  const { world } = window.cockpit;
  /** Of the tip, or of the commanded tip if it is drawn, in the world [m]. */
  const position = (shown) => {
    if (shown && world.ghost.visible) return world.ghost.position.clone();
    const tip = window.cockpit.tip();
    return world.ghost.position.clone().set(...tip);
  };
  /** From the tip to the target as the camera on the base sees it [m]. */
  const displacement = (target, shown) => {
    const base = world.frames.pose(world.baseFrame);
    const from = position(shown);
    const to = from.clone().set(...target);
    const inverse = base.clone().invert();
    return to.applyMatrix4(inverse).sub(from.applyMatrix4(inverse)).toArray();
  };
  const deflect = ([x, y, z], enabled) => window.setPad([-y, -x, 0, -z], enabled ? [0] : []);
  let timer;
  window.pilot = {
    displacement,
    inBase: (target) => window.pilot.displacement(target, false),
    deflect,
    stop() {
      clearInterval(timer);
      deflect([0, 0, 0], false);
    },
    /** Steers to the target until the tip has stayed there; times [s] and the path's length [m]. */
    steer({ target, gain, predictive, arrived, settled, longest }) {
      const images = [];
      let [seen, next, since, path] = [[0, 0, 0], 0, undefined, 0];
      const start = performance.now();
      let last = position(false);
      return new Promise((resolve) => {
        timer = setInterval(() => {
          const time = (performance.now() - start) / 1000;
          if (time >= next) {
            next = Math.max(next, time - imagePeriod) + imagePeriod;
            images.push({ at: time, displacement: displacement(target, predictive) });
          }
          while (images[0] && images[0].at + reaction <= time) seen = images.shift().displacement;
          const full = seen.map((d, i) => Math.max(-1, Math.min(1, d * gain[i])));
          deflect(full, true);
          const now = position(false);
          path += now.distanceTo(last);
          last = now;
          const near = Math.hypot(...displacement(target, false)) <= arrived;
          since = near ? (since ?? time) : undefined;
          if ((since !== undefined && time - since >= settled) || time >= longest) {
            window.pilot.stop();
            resolve({ time: since !== undefined && time - since >= settled ? since : null, path, stalls: window.cockpit.operator.stalls });
          }
        }, 10);
      });
    },
  };
}

/** A reset robot at rest, with nothing on its way. */
async function restart(page, delay) {
  await page.evaluate(() => window.pilot.stop());
  await sleep(1000 * delay + 200);
  await page.click("#reset");
  await until(page, `cockpit.clock() < 0.5 && ${STOPPED}`);
  await sleep(300);
}

/** The tip's speed per deflection along each axis at the start, which a trained operator knows [m/s]. */
async function learn(page) {
  const speeds = [];
  for (let axis = 0; axis < 3; axis++) {
    await restart(page, 0);
    speeds.push(
      await page.evaluate(async (axis) => {
        const wish = [0, 0, 0];
        wish[axis] = 0.2;
        const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
        const at = () => ({ time: cockpit.clock(), d: window.pilot.inBase([0, 0, 0])[axis] });
        window.pilot.deflect(wish, true);
        await pause(700);
        const first = at();
        await pause(700);
        const second = at();
        window.pilot.stop();
        return (first.d - second.d) / (second.time - first.time) / 0.2;
      }, axis),
    );
  }
  return speeds;
}

const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;
const deviation = (values) => Math.sqrt(mean(values.map((v) => (v - mean(values)) ** 2)) * (values.length / Math.max(1, values.length - 1)));

const folder = mkdtempSync(join(tmpdir(), "positioning-"));
const chrome = await browser();
const run = await launch(scenario(folder));
const rows = [];
try {
  const page = await open(chrome.context, run.url);
  await ready(page);
  await takeControl(page);
  await page.evaluate(installOperator, { reaction: REACTION, imagePeriod: IMAGE_PERIOD });
  await page.fill("#speed", "1");
  const home = await page.evaluate(() => cockpit.tip());
  if (Math.hypot(...START.map((s, i) => s - home[i])) > 1e-3) throw new Error(`the tip starts at ${home}, not at ${START}`);
  for (const [method, published] of Object.entries(METHODS)) {
    await page.fill("#delay", "0");
    await page.selectOption("#method", method);
    await until(page, `cockpit.parameters.values.get("/teleop.method")?.value === "${method}"`);
    const speeds = await learn(page);
    for (const { delay, predictive } of CONDITIONS) {
      await page.fill("#delay", String(delay));
      await page.setChecked("#predictive", predictive);
      const lag = REACTION + IMAGE_PERIOD / 2 + (predictive ? 0 : delay);
      const crossover = Math.min(CROSSOVER, LARGEST_LAG / lag);
      const attempts = [];
      for (const from of targets) {
        await restart(page, delay);
        const target = START.map((s, i) => s + from[i]);
        const gain = speeds.map((speed) => crossover / speed);
        attempts.push(
          await page.evaluate((steered) => window.pilot.steer(steered), {
            target, gain, predictive, arrived: ARRIVED, settled: SETTLED, longest: LONGEST,
          }),
        );
      }
      const times = attempts.map((a) => a.time).filter((t) => t !== null);
      const row = {
        method, delay, predictive, crossover, arrived: times.length, attempts: attempts.length,
        mean: mean(times), deviation: deviation(times), path: mean(attempts.map((a) => a.path / DISTANCE)),
        published: delay === 0 ? published : undefined, times,
      };
      rows.push(row);
      const compared = row.published ? ` (published ${published[0]} ± ${published[1]})` : "";
      console.log(
        `| ${method} | ${delay} s | ${predictive ? "yes" : "no"} | ${row.arrived} of ${row.attempts} | ${row.mean.toFixed(2)} ± ${row.deviation.toFixed(2)} s${compared} | ${row.path.toFixed(2)} |`,
      );
    }
  }
  const { stalls, trips } = await page.evaluate(() => ({ stalls: cockpit.operator.stalls, trips: [...cockpit.operator.roundTrips] }));
  trips.sort((a, b) => a - b);
  console.log(`round trips: median ${trips[trips.length >> 1]?.toFixed(1)} ms; stalls: ${stalls}`);
  if (page.problems.length > 0) throw new Error(page.problems.join("\n"));
} finally {
  await run.stop();
  await chrome.close();
  rmSync(folder, { recursive: true, force: true });
}
if (options.json) writeFileSync(options.json, JSON.stringify(rows, undefined, 1) + "\n");
