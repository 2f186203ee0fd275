// The page: joins the line to the session with what is shown and what can be touched.

import { Menu, Pending, Slider, digits, fill } from "./controls.js";
import { Floor } from "./floor.js";
import { Bars, Fleet, Header } from "./gauges.js";
import { Line, newest } from "./line.js";
import { put } from "./put.js";

const DRAG_MS = 150; // between two places of a goal that is being dragged
const VIEW_MS = 10_000; // as GAP_S of rerun_proxy.py: a tracer that is gone for less may be held up; to load Rerun again takes longer
const STATE_S = 3.0; // a state that is older than this is told

const by = (id) => document.getElementById(id);
const pending = new Pending();
const header = new Header(), bars = new Bars();
const fleet = new Fleet(async (name) => (await give("drain", name)).refusal);
const floor = new Floor(document.querySelector("#floor canvas"), moveGoal);
let viewed = -Infinity, tracer = ""; // when a tracer was there, and which
let offer = null, picture = null, told = null, lost = true;
let weights = [], parameters = [], settings = new Map();

const line = new Line({
  steers: (may) => { document.body.classList.toggle("watching", !may); },
  offer: (made) => { offer = made; build(); },
  picture: (now) => { picture = now; lost = false; show(); },
  lost: () => { lost = true; showBanner(); },
});

// Shows why a command was refused, for a while; returns what came of it.
async function say(what, answer) {
  const { refusal, tick } = await answer;
  told = refusal ? { text: `${what} refused: ${refusal}`, until: performance.now() + 6000 } : null;
  showBanner();
  return { refusal, tick };
}

const give = (verb, name = "", value = "") => say([verb, name].join(" ").trim(), line.give(verb, name, value));

// Sets a number and shows it until a plan has been asked for with it.
async function set(verb, name, value, key) {
  const text = Array.isArray(value) ? value.join() : value;
  const entry = pending.set(key, text);
  const { refusal, tick } = await give(verb, name, text);
  entry.tick = refusal ? -1 : tick;
  return refusal;
}

function build() {
  pending.clear();
  by("task").textContent = offer.task;
  by("task").title = offer.description;
  document.title = `${offer.task} · sumo-dist`;
  by("seed").value = offer.seed;
  const tasks = offer.tasks.includes(offer.source) ? offer.tasks : [offer.source, ...offer.tasks];
  fill(by("tasks"), tasks);
  by("tasks").value = offer.source;
  bars.begin(offer.terms);
  floor.begin(offer);
  weights = offer.weights.map((range) =>
    new Slider(range, range.name, (value) => set("weight", range.name, value, `w ${range.name}`)));
  by("weights").replaceChildren(...weights.map((slider) => slider.element));
  parameters = offer.parameters.map((numbers) => numbers.map((range, i) =>
    new Slider(range, numbers.length > 1 ? `${range.name} ${"xyz"[i] ?? i + 1}` : range.name, (value) => {
      const values = valuesOf(range.name).map((old, j) => (i === j ? value : old));
      return set("parameter", range.name, values, `p ${range.name}`);
    })));
  by("parameters").replaceChildren(...parameters.flat().map((slider) => slider.element));
  settings = new Map();
  const menus = [], sliders = [];
  for (const range of offer.settings) {
    const send = (value) => set("planner", range.name, value, `s ${range.name}`);
    const made = range.kind === "choice" ? new Menu(range, send) : new Slider(range, range.name, send);
    settings.set(range.name, made);
    (range.kind === "choice" ? menus : sliders).push(made.element);
  }
  by("menus").replaceChildren(...menus);
  by("settings").replaceChildren(...sliders);
}

// The numbers of a parameter, as they were set or as the newest plan has them.
function valuesOf(name) {
  const at = offer.parameters.findIndex(([first]) => first.name === name);
  const start = offer.parameters.slice(0, at).reduce((sum, numbers) => sum + numbers.length, 0);
  const size = offer.parameters[at].length;
  const now = picture.numbers?.parameters.slice(start, start + size) ?? offer.parameters[at].map((r) => r.default);
  return String(pending.shown(`p ${name}`, now.join(), picture.numbers?.tick ?? 0)).split(",").map(Number);
}

function show() {
  header.show(picture, offer);
  fleet.show(picture.workers, picture.events);
  put(by("pause"), { textContent: picture.robot.mode === "paused" ? "Play" : "Pause" });
  put(by("step"), { disabled: picture.robot.mode !== "paused" });
  put(by("stand"), { disabled: picture.robot.mode !== "stopped" });
  showView();
  showBanner();
  if (offer?.run !== picture.run) return; // of a new episode the plans may come before the offer
  bars.show(picture.plan);
  floor.show(picture.floor, offer.places.map((name) => { const [x, y] = valuesOf(name); return { name, x, y }; }));
  put(by("floor-hint"), { textContent: floor.hint });
  if (picture.numbers) showNumbers(picture.numbers);
}

function showNumbers(numbers) {
  const shown = (key, value) => pending.shown(key, value, numbers.tick);
  offer.weights.forEach(({ name }, i) => weights[i].show(shown(`w ${name}`, numbers.weights[i])));
  offer.parameters.forEach(([{ name }], i) => {
    valuesOf(name).forEach((value, j) => parameters[i][j].show(value));
  });
  for (const [name, control] of settings) control.show(shown(`s ${name}`, numbers.settings[name]));
}

// Rerun's page under this page's own address, so that one port is enough.
function showView() {
  const frame = document.querySelector("#view iframe"), note = document.querySelector("#view .note");
  const another = picture.view && picture.view !== tracer; // Rerun does not find its data again
  if (picture.view) { viewed = performance.now(); tracer = picture.view; }
  const wanted = by("scene").checked, shown = wanted && performance.now() - viewed < VIEW_MS;
  document.body.classList.toggle("flat", !wanted);
  const missing = wanted ? "No tracer on this machine shows this run in 3D." : "The 3D view is off.";
  put(note, { textContent: missing, hidden: shown });
  if (shown === !frame.hidden && !another) return;
  frame.hidden = !shown;
  if (!shown) { frame.removeAttribute("src"); return; }
  const host = otherName(), data = `rerun+${location.protocol}//${host}/proxy`;
  frame.src = `${location.protocol}//${host}/view/?url=${encodeURIComponent(data)}&hide_welcome_screen&theme=dark`;
}

// On this machine the view has the other name of it: a page of another site runs in a process of its
// own, so that a browser that draws without a GPU, seconds a frame, does not hold up the stop button.
function otherName() {
  const other = { localhost: "127.0.0.1", "127.0.0.1": "localhost" }[location.hostname];
  return other ? location.host.replace(location.hostname, other) : location.host;
}

function banner() {
  if (lost) return ["No line to the control service. The robot goes on; sumo-dist stop in a terminal stops it.", "bad"];
  if (told && performance.now() < told.until) return [told.text, "warn"];
  const { robot, end, services } = picture;
  if (end) {
    const more = end.last ? "sumo-dist replay shows it again; with --stay a run waits for Reset." : "Reset, or choose a task.";
    return [`The episode has ended: ${end.reason}. ${more}`, end.success ? "good" : "warn"];
  }
  if (offer === null) return ["Waiting for an episode.", "warn"];
  if (robot.mode === "stopped") return ["The robot has stopped. Stand up lets it go on.", "bad"];
  const missing = ["robot", "estimator", "optimizer"].filter((role) => !services.includes(role));
  if (missing.length) return [`Gone: ${missing.join(", ")}.`, "bad"];
  if (!picture.workers.some((worker) => worker.alive)) return ["No worker is there: no plans.", "bad"];
  if (robot.silent_s > STATE_S && robot.mode !== "paused") return [`No state for ${robot.silent_s} s.`, "warn"];
  return ["", ""];
}

function showBanner() {
  const [text, level] = picture || lost ? banner() : ["", ""];
  put(by("banner"), { hidden: text === "", textContent: text, className: level });
  document.body.classList.toggle("stale", lost);
}

const moves = new Map(); // by the name of a place
function moveGoal(name, x, y) {
  if (!moves.has(name)) moves.set(name, newest((to) => set("parameter", name, to, `p ${name}`)));
  moves.get(name)([x, y]);
}

function stopByKey(event) {
  if (event.key === "Escape") { give("stop", "", "the page"); event.preventDefault(); }
}

const pause = () => give(picture?.robot.mode === "paused" ? "resume" : "pause");
const reset = () => give("reset", "", by("seed").value);
const reseed = () => { by("seed").value = Number(by("seed").value) + 1; return reset(); };
const KEYS = { p: pause, s: () => give("step", "", 1), S: () => give("step", "", 25), r: reset, n: reseed, g: () => give("stand") };

by("scene").checked = localStorage.getItem("scene") !== "off";
by("scene").onchange = () => {
  localStorage.setItem("scene", by("scene").checked ? "on" : "off");
  if (picture) showView();
};
by("view").onmouseleave = () => window.focus(); // keys are the page's again
by("stop").onclick = () => give("stop", "", "the page");
by("pause").onclick = pause;
by("step").onclick = (event) => give("step", "", event.shiftKey ? 25 : 1);
by("stand").onclick = () => give("stand");
by("reset").onclick = reset;
by("reseed").onclick = reseed;
by("tasks").onchange = async () => {
  by("tasks").blur();
  const { refusal } = await give("task", by("tasks").value, by("seed").value);
  if (refusal) by("tasks").value = offer.source;
};
document.addEventListener("keydown", stopByKey, true);
document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("input[type=number], select");
  if (!typing && !event.ctrlKey && !event.metaKey && !event.altKey) KEYS[event.key]?.();
});
