// Plots over the last minute: at most ten points a second, so that the memory they use does not grow.

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";

const WINDOW = 60;
const RATE = 10;
const COLOURS = ["#6cb6ff", "#7ee2a0", "#ffcf66", "#ff9c93", "#d6a3ff", "#7fe3e3", "#f0f0f0"];

export class Plot {
  private readonly plot: uPlot;
  private readonly title: HTMLElement;
  private readonly box: HTMLElement;
  private data: (number | null)[][];
  private names: string[] = [];
  private last = -Infinity;

  constructor(parent: HTMLElement, private readonly name: string, private readonly unit: string) {
    const box = document.createElement("div");
    box.className = "plot";
    this.title = document.createElement("h3");
    this.title.textContent = `${name} [${unit}]: no data`;
    box.append(this.title);
    // Without data there is nothing to see.
    box.hidden = true;
    parent.append(box);
    this.data = [[]];
    this.box = box;
    const values = (_: uPlot, ticks: number[]) => ticks.map((v) => (v === 0 ? "0" : Number(v.toPrecision(3)).toString()));
    const axis = { values, stroke: "#b3bfcd", grid: { stroke: "#3a4656", width: 1 }, ticks: { stroke: "#3a4656" }, size: 56 };
    this.plot = new uPlot(
      {
        width: 320, height: 110, legend: { show: false }, cursor: { show: false },
        scales: { x: { time: false } }, axes: [{ ...axis, size: 28, values: undefined }, axis], series: [{}],
      },
      [[]],
      box,
    );
    new ResizeObserver(() => this.plot.setSize({ width: Math.max(160, box.clientWidth), height: 110 })).observe(box);
  }

  /** Adds values at a time [s]. Time that runs backwards starts the plot again. */
  add(time: number, values: Record<string, number>): void {
    const names = Object.keys(values);
    if (time < this.last - 1 || names.join() !== this.names.join()) this.restart(names);
    if (time - this.last < 1 / RATE) return;
    this.last = time;
    this.box.hidden = false;
    this.data[0].push(time);
    names.forEach((name, i) => this.data[i + 1].push(Number.isFinite(values[name]) ? values[name] : null));
    while ((this.data[0][0] ?? 0)! < time - WINDOW) for (const column of this.data) column.shift();
    const shown = names.map((name) => `${name} ${format(values[name])}`).join(", ");
    this.title.textContent = `${this.name} [${this.unit}]: ${shown}`;
  }

  private restart(names: string[]): void {
    for (const _ of this.names) this.plot.delSeries(1);
    names.forEach((label, i) => this.plot.addSeries({ label, stroke: COLOURS[i % COLOURS.length], width: 1.5, points: { show: false } }));
    this.names = names;
    this.data = [[], ...names.map(() => [])];
    this.last = -Infinity;
  }

  draw(): void {
    if (this.data[0].length > 0) this.plot.setData(this.data as uPlot.AlignedData);
  }
}

export function format(value: number): string {
  if (!Number.isFinite(value)) return "–";
  return Math.abs(value) >= 0.01 || value === 0 ? value.toFixed(3) : value.toExponential(1);
}
