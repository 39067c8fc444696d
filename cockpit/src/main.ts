// The operator's page: joins connection, scene, views, steering and panels.

import { Matrix4, Quaternion, Vector3 } from "three";
import { Connection, type Message } from "./connection";
import { Images } from "./images";
import { Input } from "./input";
import { POSE_STAMPED, seconds, stamp } from "./messages";
import { Mapping, Operator } from "./operator";
import { Diagnostics, Parameters, Simulation, element } from "./panels";
import { Plot, format } from "./plots";
import { World, rollPitchYaw } from "./scene";
import { Stage, type Layout } from "./stage";

/** Names of the methods of teleop, and what chapter 8 of Masutani's thesis calls them. */
const METHODS: Record<string, string> = {
  inverse_generalized: "inverse, generalized Jacobian",
  inverse_fixed_base: "inverse, fixed-base Jacobian",
  transpose_generalized: "transpose, generalized Jacobian",
  transpose_fixed_base: "transpose, fixed-base Jacobian",
};
const FRAMES: Record<string, string> = { base: "base", tip: "tip", world: "world" };
/** An image older than this is marked [s]. */
const OLD = 0.5;

// The token stays in the address's fragment, which browsers do not send, and survives a reload.
const token = new URLSearchParams(location.hash.slice(1)).get("token");
const scheme = location.protocol === "https:" ? "wss" : "ws";
const query = token ? `?token=${encodeURIComponent(token)}` : "";
const connection = new Connection(`${scheme}://${location.host}/ws${query}`);

const world = new World(connection);
const stage = new Stage(element<HTMLCanvasElement>("canvas"), element("stage"), world);
const images = new Images(connection, stage, (topic) => world.isOther(topic));
const input = new Input(element("stage"), () => hold());
input.stick(element("stick-left"), "left");
input.stick(element("stick-right"), "right");
const operator = new Operator(connection, input);
const diagnostics = new Diagnostics();
const parameters = new Parameters(connection);
const simulation = new Simulation(connection, () => {
  world.clearTrail();
  firstMomentum = undefined;
});
const plots = {
  tip: new Plot(element("plots"), "tip error", "m"),
  rates: new Plot(element("plots"), "joint rates", "rad/s"),
  base: new Plot(element("plots"), "base attitude", "deg"),
  momentum: new Plot(element("plots"), "momentum residual", "N s, N m s"),
  latency: new Plot(element("plots"), "latency", "ms"),
};

/** Latest simulated time, and when it and the latest state arrived by this page's clock [s, ms, ms]. */
let clock = 0;
let clockArrived = 0;
let stateStamp: number | undefined;
let stateArrived = -Infinity;
let rates: number[] = [];
/** Momentum at the beginning of the run. */
let firstMomentum: { linear: Vector3; angular: Vector3; stamp: number } | undefined;

connection.onNotice = (text) => (element("notice").textContent = text);
connection.onTime = (time) => {
  clock = Number(time) * 1e-9;
  clockArrived = performance.now();
};
connection.onState = (state) => {
  const shown = { connecting: "lost", watching: "watching", "may operate": "may operate" }[state];
  const cell = element("connection");
  cell.textContent = shown;
  cell.className = state === "connecting" ? "error" : "ok";
  if (state === "connecting") {
    world.reset();
    images.clear();
    diagnostics.clear();
    parameters.clear();
    stateArrived = -Infinity;
    firstMomentum = undefined;
  } else {
    connection.onNotice(state === "watching" && token ? "The access token is wrong: this page only watches." : "");
  }
  operator.reset();
};
connection.onParameters = (values) => parameters.take(values);
let asked: ReturnType<typeof setTimeout> | undefined;
connection.onServices = () => {
  simulation.offer(operator.hasControl);
  // Nodes appear one after another.
  clearTimeout(asked);
  asked = setTimeout(() => void parameters.refresh(), 500);
};

world.subscribe();
connection.on((c) => c.topic.endsWith("/diagnostics"), (message) => diagnostics.take(message));
const isOwnState = (topic: string) => topic.endsWith("/joint_states") && !topic.includes("ground_truth") && !world.isOther(topic);
connection.on((c) => isOwnState(c.topic), (message, topic) => {
  stateStamp = seconds(message.header.stamp);
  stateArrived = performance.now();
  rates = [...message.velocity];
  operator.namespace = topic.replace(/joint_states$/, "");
  plots.rates.add(stateStamp, Object.fromEntries(message.name.map((name: string, i: number) => [name, message.velocity[i] ?? NaN])));
  const base = world.baseFrame ? world.frames.pose(world.baseFrame) : undefined;
  if (base) {
    const [roll, pitch, yaw] = rollPitchYaw(base).map((angle) => (angle * 180) / Math.PI);
    plots.base.add(stateStamp, { roll, pitch, yaw });
  }
});
connection.on((c) => c.topic.endsWith("/controller/state") && !world.isOther(c.topic), (message) =>
  plots.tip.add(seconds(message.header.stamp), { error: message.position_error_norm }));
connection.on((c) => /(^|\/)ground_truth\/momentum$/.test(c.topic) && !world.isOther(c.topic), (message: Message) => {
  const time = seconds(message.header.stamp);
  const part = (v: Message) => new Vector3(v.x, v.y, v.z);
  const [linear, angular] = [part(message.linear), part(message.angular)];
  if (!firstMomentum || time < firstMomentum.stamp) firstMomentum = { linear, angular, stamp: time };
  plots.momentum.add(time, { linear: linear.distanceTo(firstMomentum.linear), angular: angular.distanceTo(firstMomentum.angular) });
});
connection.on((c) => c.topic.endsWith("/camera_info") && !world.isOther(c.topic), (info: Message) => {
  if (info.k[4] > 0) stage.pinhole = { fy: info.k[4], width: info.width, height: info.height };
});

// Parameters of the node teleop: what the joystick is, and which method and axes are in use.
const teleop = (name: string) => `${operator.namespace}teleop.${name}`;
parameters.onChange = () => {
  const value = (name: string) => parameters.values.get(teleop(name))?.value;
  const { mapping } = operator;
  mapping.axes = Mapping.NAMES.map((name, i) => {
    const axis = value(`axis_${name}`);
    return typeof axis === "number" ? (axis >= 0 ? axis : undefined) : mapping.axes[i];
  });
  mapping.scales = Mapping.NAMES.map((name, i) => Number(value(`scale_${name}`) ?? mapping.scales[i]));
  mapping.deadband = Number(value("deadband") ?? mapping.deadband);
  const button = value("enable_button");
  if (typeof button === "number") mapping.enableButton = button >= 0 ? button : undefined;
  const tip = value("tip_link") ?? parameters.values.get(`${operator.namespace}controller.tip_link`)?.value;
  if (typeof tip === "string") world.tipLink = tip;
  choose("method", METHODS, value("method"));
  choose("frame", FRAMES, value("frame"));
};

function choose(id: string, names: Record<string, string>, value: unknown): void {
  const select = element<HTMLSelectElement>(id);
  if (select.options.length === 0) {
    for (const [name, label] of Object.entries(names)) select.add(new Option(label, name));
    select.addEventListener("change", () => void parameters.set(teleop(id), select.value).then(() => parameters.onChange()));
  }
  if (typeof value === "string" && document.activeElement !== select) select.value = value;
  select.disabled = typeof value !== "string" || !operator.hasControl;
}
choose("method", METHODS, undefined);
choose("frame", FRAMES, undefined);

operator.onChange = (role) => {
  element("role").textContent = role;
  const control = element<HTMLButtonElement>("control");
  control.disabled = connection.state !== "may operate";
  control.textContent = operator.hasControl ? "Release control" : "Take control";
  const hold = element("hold");
  hold.setAttribute("aria-pressed", String(operator.holding));
  element<HTMLButtonElement>("goal-send").disabled = !operator.hasControl;
  simulation.offer(operator.hasControl);
  choose("method", METHODS, parameters.values.get(teleop("method"))?.value);
  choose("frame", FRAMES, parameters.values.get(teleop("frame"))?.value);
};
function hold(): void {
  operator.hold();
}

element("control").addEventListener("click", () => operator.toggle());
element("hold").addEventListener("click", hold);
function numeric(id: string, use: (value: number) => void): void {
  const field = element<HTMLInputElement>(id);
  const apply = () => Number.isFinite(field.valueAsNumber) && field.validity.valid && use(field.valueAsNumber);
  field.addEventListener("input", apply);
  apply();
}
numeric("speed", (value) => {
  operator.speed = value;
  element("speed-value").textContent = `${Math.round(100 * value)} %`;
});
numeric("delay", (value) => (operator.delay = value));
numeric("eye-distance", (value) => (stage.eyeDistance = value));
const layout = element<HTMLSelectElement>("layout");
layout.addEventListener("change", () => (stage.layout = layout.value as Layout));

const goal = element<HTMLFormElement>("goal");
const coordinate = (name: string) => goal.elements.namedItem(name) as HTMLInputElement;
element("goal-here").addEventListener("click", () => {
  const pose = world.tip ? world.linkPose(world.tip) : undefined;
  if (pose) ["x", "y", "z"].forEach((name, i) => (coordinate(name).value = pose.elements[12 + i].toFixed(3)));
});
goal.addEventListener("submit", (event) => {
  event.preventDefault();
  const pose = world.tip ? world.linkPose(world.tip) : undefined;
  const orientation = new Quaternion().setFromRotationMatrix(pose ?? new Matrix4());
  const [x, y, z] = ["x", "y", "z"].map((name) => coordinate(name).valueAsNumber);
  const { x: qx, y: qy, z: qz, w } = orientation;
  connection.publish(`${operator.namespace}goal_pose`, POSE_STAMPED.type, POSE_STAMPED.text, {
    header: { stamp: stamp(1000 * clock), frame_id: "world" },
    pose: { position: { x, y, z }, orientation: { x: qx, y: qy, z: qz, w } },
  });
});

/** Time of a message from the server to this page, estimated [s]. */
const way = () => (operator.roundTrips.at(-1) ?? 0) / 2000;

/** Time since the state that is shown was computed [s]. */
const stateAge = () => (performance.now() - stateArrived) / 1000 + way();

/** Time since the picture that is shown was taken [s]. */
function pictureAge(): number | undefined {
  const picture = images.stamps.left;
  if (picture === undefined) return undefined;
  return Math.max(0, clock - picture) + (performance.now() - clockArrived) / 1000 + way();
}

/** Age of the picture, or of the state where there are no pictures [s]. */
const imageAge = () => pictureAge() ?? stateAge();

/** What has been commanded and is not seen yet, in the world's axes [m]. */
function commanded(age: number): Vector3 | undefined {
  if (!element<HTMLInputElement>("predictive").checked || !operator.hasControl) return undefined;
  const pending = operator.pending(age);
  const frame = String(parameters.values.get(teleop("frame"))?.value ?? "base");
  const link = frame === "base" ? world.baseFrame : frame === "tip" ? world.tip : undefined;
  const pose = link ? world.linkPose(link) : undefined;
  if (pose) pending.applyQuaternion(new Quaternion().setFromRotationMatrix(pose));
  return pending.length() > 1e-3 ? pending : undefined;
}

let lastFigures = 0;
stage.renderer.setAnimationLoop(() => {
  const now = performance.now();
  const age = imageAge();
  world.showCommanded(commanded(age));
  stage.draw();
  if (now - lastFigures < 100) return;
  lastFigures = now;
  showFigures(age);
});

function show(id: string, text: string, level = ""): void {
  const cell = element(id);
  if (cell.textContent !== text) cell.textContent = text;
  if (cell.className !== level) cell.className = level;
}

function showFigures(age: number): void {
  const trip = operator.roundTrip;
  const late = operator.stalled || connection.state === "connecting";
  show("round-trip", trip === undefined || connection.state === "connecting" ? "–" : `${trip.toFixed(1)} ms`, late ? "error" : "");
  show("image-age", Number.isFinite(age) ? `${(1000 * age).toFixed(0)} ms` : "–", age > OLD ? "error" : "");
  show("time", `${clock.toFixed(1)} s`);
  const fastest = Math.max(0, ...rates.map(Math.abs));
  show("arm", fastest > 1e-3 ? `moving, ${format(fastest)} rad/s` : "stopped", fastest > 1e-3 ? "warn" : "");
  const split = stage.layout === "split";
  const source = images.stamps.left === undefined ? "rendered by this page from the robot's state" : "camera images";
  const views = { split: "stereo pair", stereo: "stereo pair", anaglyph: "anaglyph", overview: "" }[stage.layout];
  const missing = stage.hasCamera ? "" : "; the description has no camera frame";
  element("label-stereo").textContent = views ? `${views}: ${source}${missing}` : "";
  element("label-overview").hidden = !split && stage.layout !== "overview";
  element("gamepad").textContent = input.gamepad
    ? `Gamepad: ${input.gamepad}. A enables, B holds.`
    : input.unknownGamepad
      ? `Gamepad: ${input.unknownGamepad} is not used, since its browser does not know its layout.`
      : "No gamepad. Press one of its buttons to connect it; A enables, B holds.";
  if (trip !== undefined && Number.isFinite(age) && connection.state !== "connecting") {
    plots.latency.add(performance.now() / 1000, { "round trip": trip, "image age": 1000 * age });
  }
}
setInterval(() => Object.values(plots).forEach((plot) => plot.draw()), 250);
setInterval(() => void simulation.poll(), 1000);

// VR, where the browser has it.
const xr = navigator.xr;
if (xr) {
  void xr.isSessionSupported("immersive-vr").then((supported) => (element("vr").hidden = !supported));
  element("vr").addEventListener("click", async () => {
    stage.renderer.xr.enabled = true;
    try {
      const session = await xr.requestSession("immersive-vr", { optionalFeatures: ["local"] });
      stage.renderer.xr.setReferenceSpaceType("local");
      await stage.renderer.xr.setSession(session);
      session.addEventListener("end", () => (stage.renderer.xr.enabled = false));
    } catch (error) {
      connection.onNotice(`VR: ${String(error)}`);
    }
  });
}

connection.open();

/** For tests: what is shown, in numbers. */
Object.assign(window, {
  cockpit: {
    world, stage, operator, connection, parameters, images,
    tip: () => (world.tip ? new Vector3().setFromMatrixPosition(world.linkPose(world.tip) ?? new Matrix4()).toArray() : undefined),
    projected: (view: "left" | "right" | "overview") => {
      const pose = world.tip ? world.linkPose(world.tip) : undefined;
      return pose ? stage.project(new Vector3().setFromMatrixPosition(pose), view) : undefined;
    },
    rates: () => rates,
    clock: () => clock,
    stateAge,
    pictureAge,
  },
});
