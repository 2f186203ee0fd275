// What is shown and not touched: the header's numbers, cost bars, workers and events.

import { digits } from "./controls.js";
import { put } from "./put.js";

const MODES = {
  running: "good", paused: "warn", waiting: "warn", stopping: "bad", stopped: "bad", rising: "warn",
  gone: "bad", ended: "warn",
};
const BEHIND = 1.5; // plans older than this many periods are shown as late

const ms = (number) => (number == null ? "–" : `${number < 10 ? number.toFixed(1) : Math.round(number)} ms`);

// Each: [name, what it means, picture => [text, level]]
const GAUGES = [
  ["time", "robot time since the start, and the limit", ({ robot }, offer) => [`${robot.s.toFixed(1)} of ${digits(offer?.limit_s ?? NaN)} s`]],
  ["speed", "robot time per wall time", ({ robot }) => [`${robot.speed.toFixed(2)} ×`]],
  ["plan", "wall time of the newest plan, and what it may take at this speed", ({ plan }) =>
    [plan?.budget_ms ? `${ms(plan.ms)} of ${ms(plan.budget_ms)}` : ms(plan?.ms), plan?.budget_ms && plan.ms > plan.budget_ms ? "bad" : ""]],
  ["rate", "plans a second of wall time", ({ plan }) => [plan ? `${plan.per_s.toFixed(1)} /s` : "–"]],
  ["age", "robot time between a plan's state and its arrival", ({ plan }) =>
    [ms(plan?.age_ms), plan && plan.age_ms > BEHIND * plan.period_ms ? "warn" : ""]],
  ["missed", "plans that never came in this episode", ({ plan }) => [plan ? plan.missed : "–", plan?.missed ? "warn" : ""]],
  ["rollouts", "candidates of the newest plan; lost: not answered in time", ({ plan }) =>
    [plan ? `${plan.rollouts - plan.lost}${plan.lost ? `, ${plan.lost} lost` : ""}` : "–", plan?.failed ? "bad" : plan?.lost ? "warn" : ""]],
];

export class Header {
  constructor() {
    this.fields = GAUGES.map(([name, about, read]) => {
      const box = document.createElement("div");
      box.title = about;
      box.innerHTML = "<dt></dt><dd></dd>";
      box.firstChild.textContent = name;
      document.getElementById("gauges").append(box);
      return [box.lastChild, read];
    });
  }

  show(picture, offer) {
    for (const [field, read] of this.fields) {
      const [text, level = ""] = read(picture, offer);
      put(field, { textContent: String(text), className: level });
    }
    const mode = picture.end?.last ? "ended" : picture.robot.mode;
    put(document.getElementById("mode"), { textContent: mode, className: `badge ${MODES[mode] ?? ""}` });
  }
}

export class Bars {
  #box = document.querySelector("#costs .bars"); #rows = []; #high = 1e-9;

  begin(terms) {
    this.#high = 1e-9;
    this.#rows = terms.map((term) => {
      const row = document.createElement("div");
      row.className = "bar";
      row.innerHTML = "<span></span><i></i><b></b>";
      row.firstChild.textContent = row.title = term;
      return row;
    });
    this.#box.replaceChildren(...this.#rows);
  }

  show(plan) {
    if (!plan) return;
    const now = Math.max(...plan.terms.map(Math.abs), 1e-9);
    this.#high = Math.max(now, 0.98 * this.#high); // bars do not jump when the largest shrinks
    plan.terms.forEach((value, i) => {
      const [, bar, text] = this.#rows[i].children;
      put(bar.style, { width: `${Math.round((100 * Math.abs(value)) / this.#high)}%` });
      put(bar, { className: value < 0 ? "negative" : "" });
      put(text, { textContent: digits(value) });
    });
    const best = plan.best == null ? "none finite" : `${digits(plan.best)} the best`;
    put(document.getElementById("cost-total"), { textContent: `${digits(plan.cost)} unperturbed, ${best}` });
  }
}

export class Fleet {
  #rows = new Map(); #body = document.querySelector("#fleet tbody"); #newest = 0;
  #events = document.querySelector("#fleet .events"); #drain;

  constructor(drain) { this.#drain = drain; }

  show(workers, events) {
    const alive = workers.length ? `${workers.filter((w) => w.alive).length}` : "none";
    put(document.getElementById("workers-count"), { textContent: alive });
    const names = new Set(workers.map((worker) => worker.name));
    for (const [name, row] of this.#rows) if (!names.has(name)) { row.remove(); this.#rows.delete(name); }
    for (const worker of workers) this.#showWorker(worker);
    this.#showEvents(events);
  }

  #showWorker(worker) {
    let row = this.#rows.get(worker.name);
    if (!row) {
      row = this.#body.insertRow();
      for (let i = 0; i < 6; i++) row.insertCell();
      const button = row.cells[5].appendChild(document.createElement("button"));
      button.textContent = "drain";
      button.title = "let it finish what it was asked, and end";
      button.onclick = async () => { button.disabled = true; button.title = await this.#drain(worker.name); button.disabled = false; };
      this.#rows.set(worker.name, row);
    }
    const well = worker.alive && (worker.state === "answers" || worker.state === "not asked");
    const texts = [worker.name, worker.host, digits(worker.per_s), worker.lost, worker.alive ? worker.state : "gone"];
    texts.forEach((text, i) => put(row.cells[i], { textContent: String(text) }));
    put(row.cells[3], { className: worker.lost ? "warn" : "" });
    put(row.cells[4], { className: well ? "" : "bad" });
  }

  #showEvents(events) {
    for (const event of events) {
      if (event.number <= this.#newest) continue;
      const item = document.createElement("li");
      item.className = event.level;
      item.innerHTML = "<time></time><span></span>";
      item.firstChild.textContent = `${event.s.toFixed(1)} s`;
      item.lastChild.textContent = event.text;
      this.#events.prepend(item);
    }
    this.#newest = events.at(-1)?.number ?? 0;
    while (this.#events.children.length > 200) this.#events.lastChild.remove();
  }
}
