// What the operator does with gamepad, keyboard, mouse and touch: a deflection per axis, and whether motion is enabled.

/** Deflections from -1 to 1: x, y, z, roll, pitch, yaw. */
export type Axes = [number, number, number, number, number, number];
export type Reading = { axes: Axes; enabled: boolean };

const KEYS: Record<string, [axis: number, sign: number]> = {
  KeyW: [0, 1], KeyS: [0, -1], KeyA: [1, 1], KeyD: [1, -1], KeyR: [2, 1], KeyF: [2, -1],
  KeyL: [3, 1], KeyJ: [3, -1], KeyI: [4, 1], KeyK: [4, -1], KeyQ: [5, 1], KeyE: [5, -1],
};
/** Buttons of a gamepad in the standard layout. */
const [ENABLE, HOLD, LB, RB, LT, RT] = [0, 1, 4, 5, 6, 7];
/** Deflection up to which a worn stick is at rest. */
const PLAY = 0.08;

/** Deflection beyond the play of a stick, from -1 to 1. */
const beyondPlay = (v: number) => (Math.abs(v) < PLAY ? 0 : (Math.sign(v) * (Math.abs(v) - PLAY)) / (1 - PLAY));

export class Input {
  private readonly pressed = new Set<string>();
  private readonly sticks = new Map<string, [number, number]>();
  private holdWasPressed = false;
  /** The gamepad in use, for display. */
  gamepad = "";
  /** One that is connected, but whose layout the browser does not know. */
  unknownGamepad = "";

  /** `hold` is called when the operator presses the key or button for it. */
  constructor(surface: HTMLElement, private readonly hold: () => void) {
    surface.addEventListener("keydown", (event) => {
      // Systems that use this key do not report the release of others while it is held.
      if (event.key === "Meta") this.pressed.clear();
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.code !== "KeyH" && event.code !== "Space" && !(event.code in KEYS)) return;
      event.preventDefault();
      // A key that repeats was pressed before the window had the focus, or is known already.
      if (event.repeat) return;
      if (event.code === "KeyH") this.hold();
      else this.pressed.add(event.code);
    });
    surface.addEventListener("keyup", (event) => this.pressed.delete(event.code));
    surface.addEventListener("blur", () => this.pressed.clear());
    // A key that is released in another window is never reported.
    window.addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
  }

  /** A stick on the page: it enables motion while it is held. Up is the first axis, left the second. */
  stick(element: HTMLElement, name: string): void {
    const knob = document.createElement("i");
    element.append(knob);
    const show = (x: number, y: number) => {
      knob.style.left = `${50 + 40 * x}%`;
      knob.style.top = `${50 + 40 * y}%`;
    };
    const move = (event: PointerEvent) => {
      const { left, top, width, height } = element.getBoundingClientRect();
      let x = (event.clientX - left - width / 2) / (0.4 * width);
      let y = (event.clientY - top - height / 2) / (0.4 * height);
      const length = Math.hypot(x, y);
      if (length > 1) [x, y] = [x / length, y / length];
      this.sticks.set(name, [-y, -x]);
      show(x, y);
    };
    const end = () => {
      this.sticks.delete(name);
      show(0, 0);
    };
    element.addEventListener("pointerdown", (event) => {
      // Other buttons open menus, which swallow the release.
      if (event.button !== 0) return;
      element.setPointerCapture(event.pointerId);
      move(event);
      event.preventDefault();
    });
    element.addEventListener("pointermove", (event) => {
      if (!this.sticks.has(name)) return;
      if (event.buttons === 0) end();
      else move(event);
    });
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    for (const type of ["pointerup", "pointercancel", "lostpointercapture"] as const) element.addEventListener(type, end);
  }

  /** Releases everything. */
  release(): void {
    this.pressed.clear();
    this.sticks.clear();
  }

  read(): Reading {
    const axes: Axes = [0, 0, 0, 0, 0, 0];
    let enabled = this.pressed.has("Space") || this.sticks.size > 0;
    for (const key of this.pressed) {
      const known = KEYS[key];
      if (known) axes[known[0]] += known[1];
    }
    const add = (axis: number, value: number) => (axes[axis] += value);
    const left = this.sticks.get("left");
    if (left) [add(0, left[0]), add(1, left[1])];
    const right = this.sticks.get("right");
    if (right) [add(2, right[0]), add(5, right[1])];
    enabled = this.readGamepad(add) || enabled;
    return { axes: axes.map((a) => Math.max(-1, Math.min(1, a))) as Axes, enabled };
  }

  /** Adds the gamepad's deflections; whether its button enables. */
  private readGamepad(add: (axis: number, value: number) => void): boolean {
    const pads = typeof navigator.getGamepads === "function" ? [...navigator.getGamepads()] : [];
    const connected = pads.filter((p) => p?.connected);
    // What axes and buttons of others are is not known.
    const pad = connected.find((p) => p?.mapping === "standard" && p.axes.length >= 4);
    this.gamepad = pad?.id ?? "";
    this.unknownGamepad = pad ? "" : (connected[0]?.id ?? "");
    // A window in the background must not steer.
    if (!pad || document.hidden || !document.hasFocus()) return false;
    const button = (i: number) => pad.buttons[i]?.value ?? 0;
    const [lx, ly, rx, ry] = pad.axes.map(beyondPlay);
    add(0, -ly);
    add(1, -lx);
    add(2, -ry);
    add(5, -rx);
    add(3, button(RB) - button(LB));
    add(4, button(RT) - button(LT));
    const hold = pad.buttons[HOLD]?.pressed ?? false;
    if (hold && !this.holdWasPressed) this.hold();
    this.holdWasPressed = hold;
    return pad.buttons[ENABLE]?.pressed ?? false;
  }
}
