// Diagnostics, parameters, and control of the simulation.

import type { Parameter } from "@foxglove/ws-protocol";
import type { Connection, Message } from "./connection";

const LEVELS = ["ok", "warn", "error", "stale"];
/** States of simulation_interfaces/SimulationState. */
const STATES: Record<number, string> = { 0: "stopped", 1: "playing", 2: "paused", 3: "quitting" };

export function element<T extends HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`no element ${id}`);
  return found as T;
}

function rows(table: string): HTMLTableSectionElement {
  return element<HTMLTableElement>(table).tBodies[0];
}

/** The table of diagnostics, one row for each status. */
export class Diagnostics {
  private readonly cells = new Map<string, HTMLTableCellElement[]>();

  take(message: Message): void {
    for (const status of message.status) {
      let cells = this.cells.get(status.name);
      if (!cells) {
        if (this.cells.size > 500) continue;
        const row = rows("diagnostics").insertRow();
        cells = [row.insertCell(), row.insertCell(), row.insertCell()];
        cells[1].textContent = status.name;
        this.cells.set(status.name, cells);
      }
      const level = LEVELS[Number(status.level)] ?? "stale";
      cells[0].textContent = level;
      cells[0].className = level === "stale" ? "error" : level;
      cells[2].textContent = status.message;
      cells[2].title = status.values.map((v: Message) => `${v.key}: ${v.value}`).join("\n");
    }
  }

  clear(): void {
    rows("diagnostics").replaceChildren();
    this.cells.clear();
  }
}

/** The table of parameters, as they are set now. */
export class Parameters {
  readonly values = new Map<string, Parameter>();
  private readonly inputs = new Map<string, HTMLInputElement>();
  /** Called when values have changed. */
  onChange: () => void = () => {};

  constructor(private readonly connection: Connection) {
    element<HTMLInputElement>("filter").addEventListener("input", () => this.show());
    element("refresh").addEventListener("click", () => void this.refresh());
  }

  async refresh(): Promise<void> {
    const all = await this.connection.getParameters([]);
    this.take(all);
    this.connection.watchParameters(all.map((p) => p.name));
  }

  take(parameters: Parameter[]): void {
    let isNew = false;
    for (const parameter of parameters) {
      isNew ||= !this.values.has(parameter.name);
      this.values.set(parameter.name, parameter);
      const input = this.inputs.get(parameter.name);
      // What is being edited stays.
      if (input && input !== document.activeElement) input.value = text(parameter);
    }
    if (isNew) this.show();
    if (parameters.length > 0) this.onChange();
  }

  clear(): void {
    this.values.clear();
    this.show();
  }

  async set(name: string, value: Parameter["value"]): Promise<void> {
    const type = this.values.get(name)?.type;
    this.take(await this.connection.setParameters([{ name, value, ...(type && { type }) }]));
  }

  private show(): void {
    const filter = element<HTMLInputElement>("filter").value.toLowerCase();
    const names = [...this.values.keys()].filter((name) => name.toLowerCase().includes(filter)).sort();
    this.inputs.clear();
    rows("parameters").replaceChildren(...names.map((name) => this.row(name)));
  }

  private row(name: string): HTMLTableRowElement {
    const parameter = this.values.get(name)!;
    const row = document.createElement("tr");
    row.insertCell().textContent = name;
    const input = document.createElement("input");
    input.value = text(parameter);
    input.setAttribute("aria-label", name);
    this.inputs.set(name, input);
    row.insertCell().append(input);
    const set = document.createElement("button");
    set.type = "button";
    set.textContent = "Set";
    set.setAttribute("aria-label", `Set ${name}`);
    const apply = () => {
      const value = read(input.value, this.values.get(name)!);
      if (value === undefined) this.connection.onNotice(`${name}: ${input.value} is not a value of its type`);
      else {
        void this.set(name, value).then(() => {
          // There is none if the connection has ended meanwhile.
          const now = this.values.get(name);
          if (now) input.value = text(now);
        });
      }
    };
    set.addEventListener("click", apply);
    input.addEventListener("keydown", (event) => event.key === "Enter" && apply());
    row.insertCell().append(set);
    return row;
  }
}

function text({ value }: Parameter): string {
  return typeof value === "string" ? value : JSON.stringify(value);
}

/** What was typed, as a value of the parameter's type. */
function read(typed: string, { value }: Parameter): Parameter["value"] {
  if (typeof value === "string") return typed;
  try {
    const parsed: unknown = JSON.parse(typed);
    const same = typeof parsed === typeof value && Array.isArray(parsed) === Array.isArray(value);
    return same ? (parsed as Parameter["value"]) : undefined;
  } catch {
    return undefined;
  }
}

/** Play, pause, step and reset by simulation_interfaces. */
export class Simulation {
  private node?: string;
  state = "unknown";

  constructor(private readonly connection: Connection, private readonly onReset: () => void) {
    const button = (id: string, run: () => Promise<Message>) =>
      element(id).addEventListener("click", () => {
        run().then((r) => this.check(r), (error: Error) => connection.onNotice(error.message));
      });
    button("play", () => this.call("set_simulation_state", { state: { state: 1 } }));
    button("pause", () => this.call("set_simulation_state", { state: { state: 2 } }));
    button("step", () => this.call("step_simulation", { steps: 1n }));
    button("reset", () => this.call("reset_simulation", { scope: 0 }).finally(this.onReset));
  }

  /** Looks for a simulation, and shows what may be done with it. */
  offer(hasControl: boolean): void {
    const suffix = "/get_simulation_state";
    const service = [...this.connection.services.keys()].find((name) => name.endsWith(suffix));
    this.node = service?.slice(0, -suffix.length);
    for (const id of ["play", "pause", "step", "reset"]) {
      element<HTMLButtonElement>(id).disabled = !hasControl || !this.node;
    }
  }

  private call(name: string, request: Message): Promise<Message> {
    return this.connection.call(`${this.node}/${name}`, request);
  }

  private check(response: Message): void {
    // RESULT_OK
    if (response.result?.result !== 1) this.connection.onNotice(response.result?.error_message ?? "the simulation refuses");
    void this.poll();
  }

  async poll(): Promise<void> {
    if (!this.node) return;
    try {
      const { state } = await this.call("get_simulation_state", {});
      this.state = STATES[state.state] ?? "unknown";
      element("simulation").textContent = this.state;
    } catch {
      // The next poll tries again.
    }
  }
}
