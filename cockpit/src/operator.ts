// The operator's side of the node teleop: control of the robot, the dead man's switch, hold, and the commands on their way.
//
// The page sends what a joystick would: messages of `joy` with the axes and the button that the parameters of the node
// state. Motion is enabled anew after every interruption only when everything has been released once.

import { Vector3 } from "three";
import { STALLED, type Connection } from "./connection";
import type { Axes, Input } from "./input";
import { JOY, stamp } from "./messages";

/** Interval between commands, and between calls that keep control and measure the round trip [ms]. */
const PERIOD = 20;
const CALL_PERIOD = 200;
/** How long commands are remembered for the predictive display [ms]. */
const MEMORY = 20_000;
/** The velocity servo of the arm follows about so much later [s]: 1 / bandwidth. */
const SERVO_LAG = 0.1;

/** Mapping of the axes of `joy`, by the parameters of the node teleop. */
export class Mapping {
  axes: (number | undefined)[] = [1, 0, 4, undefined, undefined, 3];
  scales: number[] = [0.5, 0.5, 0.5, 0.2, 0.2, 0.2];
  enableButton: number | undefined = 0;
  deadband = 0.05;

  static readonly NAMES = ["linear.x", "linear.y", "linear.z", "angular.roll", "angular.pitch", "angular.yaw"];

  /** Deflections of the axes of the message that move the tip by these fractions of the full speed. */
  message(wish: Axes, enabled: boolean): { axes: number[]; buttons: number[] } {
    const axes = new Array<number>(1 + Math.max(0, ...this.axes.map((a) => a ?? 0))).fill(0);
    this.axes.forEach((axis, i) => {
      const w = wish[i];
      if (axis !== undefined && Math.abs(w) > 1e-3) axes[axis] = Math.sign(w) * (this.deadband + (1 - this.deadband) * Math.abs(w));
    });
    const buttons = new Array<number>(1 + (this.enableButton ?? 0)).fill(0);
    if (this.enableButton !== undefined) buttons[this.enableButton] = enabled ? 1 : 0;
    return { axes, buttons };
  }

  /** Linear velocity that a wish commands, in the axes of the command [m/s]. */
  velocity(wish: Axes): Vector3 {
    const v = [0, 1, 2].map((i) => (this.axes[i] === undefined ? 0 : wish[i] * this.scales[i]));
    return new Vector3(...v);
  }
}

type Sent = { at: number; axes: Axes; enabled: boolean };

export class Operator {
  hasControl = false;
  holding = false;
  /** Whether the network has not answered lately, and how often this happened. */
  stalled = false;
  stalls = 0;
  /** Fraction of the full speed. */
  speed = 0.5;
  /** Added to the way of the commands [s]. */
  delay = 0;
  readonly mapping = new Mapping();
  /** Last round trips [ms]. */
  readonly roundTrips: number[] = [];
  /** Namespace of the robot, `/` or `/name/`. */
  namespace = "/";
  onChange: (role: string) => void = () => {};
  private wanted = false;
  private armed = false;
  private asked?: number;
  private waiting: Sent[] = [];
  private history: Sent[] = [];
  private lastEnabled = false;

  constructor(private readonly connection: Connection, private readonly input: Input) {
    setInterval(() => this.send(), PERIOD);
    setInterval(() => void this.call(), CALL_PERIOD);
    // The server stops the arm when the connection ends; this is sooner if the network still works.
    window.addEventListener("pagehide", () => this.sendNow({ at: performance.now(), axes: [0, 0, 0, 0, 0, 0], enabled: false }));
  }

  /** Takes control, or releases it. */
  toggle(): void {
    this.wanted = !this.hasControl;
    if (!this.wanted) {
      // A command that follows the release would take control again.
      this.hasControl = false;
      this.waiting = [];
      this.disarm();
      this.onChange(this.role);
    }
    void this.call();
  }

  hold(): void {
    this.holding = !this.holding;
    this.disarm();
    this.onChange(this.role);
  }

  private disarm(): void {
    this.armed = false;
  }

  /** After a connection was lost nobody steers until the operator takes control again. */
  reset(): void {
    this.hasControl = this.wanted = this.stalled = false;
    this.asked = undefined;
    this.waiting = [];
    this.disarm();
    this.onChange(this.role);
  }

  get roundTrip(): number | undefined {
    const last = this.roundTrips.at(-1);
    return this.asked === undefined ? last : Math.max(last ?? 0, performance.now() - this.asked);
  }

  get role(): string {
    if (this.connection.state === "connecting") return "not connected";
    if (this.connection.state === "watching") return "watching: to operate, open the address with the token that fuyu printed";
    if (!this.hasControl) return this.others ? "watching: another client has control" : "nobody has control";
    if (this.stalled) return "the network is stalled: the arm is stopped; release, then enable again";
    if (this.holding) return "holding: the arm stands still";
    return this.lastEnabled ? "steering" : "control taken: hold the enabling button to move";
  }

  private others = false;

  /** Takes, keeps or releases control, and measures the round trip. */
  private async call(): Promise<void> {
    const now = performance.now();
    if (this.asked !== undefined) {
      if (now - this.asked > STALLED && !this.stalled) {
        this.stalled = true;
        this.stalls += 1;
        this.disarm();
        this.onChange(this.role);
      }
      return;
    }
    const { connection } = this;
    if (connection.state === "connecting") return;
    const session = connection.session;
    this.asked = now;
    const service = [...connection.services.keys()].find((name) => name.endsWith("/foxglove/control"));
    try {
      if (connection.state === "may operate" && service) {
        const asksFor = this.wanted;
        const response = await connection.call(service, { data: asksFor });
        if (session !== connection.session) return;
        const had = this.hasControl;
        this.hasControl = response.success && this.wanted === asksFor && asksFor;
        this.others = response.message.startsWith("another");
        if (had && !response.success && this.wanted) connection.onNotice("Control is lost: " + response.message);
        // A refused wish is not repeated: the operator decides. One that is newer than the call is still to be sent.
        if (asksFor && !response.success) this.wanted = false;
        if (had !== this.hasControl) this.disarm();
      } else {
        // Watchers have no services: the refusal of a mesh without a name comes back as fast.
        await connection.fetchAsset("").catch((error: Error) => {
          if (session !== connection.session) throw error;
        });
      }
      if (session !== connection.session) return;
      this.roundTrips.push(performance.now() - now);
      if (this.roundTrips.length > 600) this.roundTrips.shift();
      this.stalled = false;
    } catch {
      // The connection has ended; `reset` follows.
    }
    if (session === connection.session) this.asked = undefined;
    this.onChange(this.role);
  }

  /** Reads the input and sends a command when it is due. */
  private send(): void {
    const now = performance.now();
    const { axes, enabled } = this.input.read();
    if (!enabled) this.armed = this.hasControl && !this.holding && !this.stalled;
    const moves = enabled && this.armed && this.hasControl && !this.holding && !this.stalled;
    const wish = axes.map((a) => (moves ? a * this.speed : 0)) as Axes;
    if (moves !== this.lastEnabled) {
      this.lastEnabled = moves;
      this.onChange(this.role);
    }
    const command = { at: now, axes: wish, enabled: moves };
    this.history.push(command);
    while (this.history[0] && this.history[0].at < now - MEMORY) this.history.shift();
    this.waiting.push(command);
    const due = now - 1000 * this.delay;
    let last: Sent | undefined;
    while (this.waiting[0] && this.waiting[0].at <= due) last = this.waiting.shift();
    // Whoever has no control sends nothing, and nobody sends into a network that does not deliver.
    if (last && this.hasControl && !this.stalled && !this.connection.congested) this.sendNow(last);
  }

  private sendNow(command: Sent): void {
    if (!this.hasControl) return;
    const header = { stamp: stamp(Date.now()), frame_id: "" };
    const message = this.mapping.message(command.axes, command.enabled);
    this.connection.publish(`${this.namespace}joy`, JOY.type, JOY.text, { header, ...message });
  }

  /** How long a command takes until its motion is seen [s]. */
  latency(imageAge: number): number {
    return this.delay + (this.roundTrip ?? 0) / 2000 + imageAge + SERVO_LAG;
  }

  /** What has been commanded and is not seen yet: the displacement of the tip, in the axes of the command [m]. */
  pending(imageAge: number): Vector3 {
    const now = performance.now();
    const from = now - 1000 * this.latency(imageAge);
    const sum = new Vector3();
    this.history.forEach((command, i) => {
      const until = this.history[i + 1]?.at ?? now;
      const time = (until - Math.max(command.at, from)) / 1000;
      if (time > 0 && command.enabled) sum.addScaledVector(this.mapping.velocity(command.axes), time);
    });
    return sum;
  }
}
