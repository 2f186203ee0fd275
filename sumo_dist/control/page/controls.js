// Menus and sliders, made from what the task and the planner declare.

import { newest } from "./line.js";
import { put } from "./put.js";

const STEPS = 1000; // of a slider

const SMALL = 1e-4; // what is below is shown as 0, so that no number has an exponent

export function digits(number) {
  if (!Number.isFinite(number)) return "–";
  return Math.abs(number) < SMALL ? "0" : String(Number(number.toPrecision(4)));
}

// What was set and is not in the newest plan's question yet.
export class Pending {
  #values = new Map();

  // Returns an entry, whose `tick` is to become that at which the value was set.
  set(key, value) {
    const entry = { value, tick: Infinity };
    this.#values.set(key, entry);
    return entry;
  }

  // The value to show, given that of the newest question and its tick.
  shown(key, value, tick) {
    const set = this.#values.get(key);
    if (set === undefined) return value;
    if (tick >= set.tick) { this.#values.delete(key); return value; }
    return set.value;
  }

  clear() { this.#values.clear(); }
}

function place(range, value) {
  const { low, high } = range;
  if (high === low) return 0;
  const part = range.log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.round(STEPS * Math.min(1, Math.max(0, part)));
}

function valueAt(range, place) {
  const { low, high } = range;
  const part = place / STEPS;
  const value = range.log ? low * (high / low) ** part : low + (high - low) * part;
  return rounded(range, value);
}

function rounded(range, value) {
  if (range.kind === "int") return Math.round(value);
  if (range.step) return Number((Math.round(value / range.step) * range.step).toFixed(6));
  return Number(value.toPrecision(4));
}

// A slider of one number. send: (value) => Promise of a refusal.
export class Slider {
  #range; #send; #held = false;

  constructor(range, label, send) {
    this.#range = range; this.#send = newest(send);
    this.element = document.createElement("div");
    this.element.className = "slider";
    this.element.innerHTML =
      '<span></span><input type="number"><button>↺</button><input type="range" min="0">';
    const [name, number, back, slide] = this.element.children;
    name.textContent = range.unit ? `${label} [${range.unit}]` : label;
    name.title = `${range.about} (${digits(range.low)} to ${digits(range.high)})`;
    number.step = range.kind === "int" ? 1 : range.step || "any";
    number.setAttribute("aria-label", label);
    slide.setAttribute("aria-label", `${label}, slider`);
    slide.max = STEPS;
    back.title = `back to ${digits(range.default)}`;
    this.number = number; this.slide = slide;
    slide.oninput = () => { this.#held = true; this.#set(valueAt(range, Number(slide.value))); };
    slide.onchange = () => { this.#held = false; };
    number.onchange = () => { if (number.value !== "") this.#set(rounded(range, Number(number.value))); };
    back.onclick = () => this.#set(range.default);
  }

  show(value) {
    if (!this.#held && document.activeElement !== this.number) this.#put(value);
  }

  #put(value) {
    put(this.number, { value: digits(value) });
    put(this.slide, { value: String(place(this.#range, value)) });
    this.element.classList.toggle("changed", Math.abs(value - this.#range.default) > 1e-9 * Math.abs(value));
  }

  async #set(value) {
    this.#put(value);
    const refusal = await this.#send(value);
    this.element.classList.toggle("refused", refusal !== "");
    this.element.title = refusal;
  }
}

// A menu of names. send: (value) => Promise of a refusal.
export class Menu {
  #taken = ""; // what the planner has, or has been told

  constructor(range, send) {
    this.element = document.createElement("label");
    this.element.title = range.about;
    this.element.append(range.name);
    this.select = this.element.appendChild(document.createElement("select"));
    this.select.setAttribute("aria-label", range.name);
    fill(this.select, range.choices);
    this.select.onchange = async () => {
      const refusal = await send(this.select.value);
      this.element.title = refusal || range.about;
      if (refusal) this.select.value = this.#taken;
    };
  }

  show(value) {
    this.#taken = String(value);
    if (document.activeElement !== this.select) put(this.select, { value: this.#taken });
  }
}

export function fill(select, names) {
  select.replaceChildren(...names.map((name) => new Option(String(name))));
}
