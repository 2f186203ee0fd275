// The floor plan: outlines from above, the ways that were walked, and a goal that can be dragged.

const GRID_M = 0.5, MARGIN_M = 0.6, LEAST_M = 3.0;
const TRAIL = 600; // places that are kept of each frame
const REACH_PX = 24;
const COLORS = { robot: "#f2c14b", thing: "#6cb6ff", fixed: "#566074" };

export class Floor {
  #canvas; #fixed = []; #frames = []; #trails = []; #floor = null; #goals = []; #box = null;
  #dragged = null; #move; #drawn = "";

  // move: (name, x, y) is told where a place is dragged to
  constructor(canvas, move) {
    this.#canvas = canvas; this.#move = move;
    canvas.onpointerdown = (event) => this.#grab(event);
    canvas.onpointermove = (event) => this.#drag(event);
    canvas.onpointerup = (event) => { this.#drag(event); this.#dragged = null; };
    canvas.onpointercancel = () => { this.#dragged = null; };
    canvas.ondblclick = (event) => this.#put(event);
  }

  begin(offer) {
    this.#fixed = offer.fixed; this.#frames = offer.frames;
    this.#trails = offer.frames.map(() => []); this.#box = null; this.#drawn = "";
  }

  // goals: [{name, x, y}]
  show(floor, goals) {
    this.#floor = floor ?? this.#floor;
    if (this.#dragged === null) this.#goals = goals;
    floor?.places.forEach(([x, y], i) => {
      const trail = this.#trails[i];
      const [lastX, lastY] = trail.at(-1) ?? [Infinity, 0];
      if (Math.hypot(x - lastX, y - lastY) > 0.01) trail.push([x, y]);
      if (trail.length > TRAIL) trail.shift();
    });
    const { clientWidth, clientHeight } = this.#canvas;
    const seen = JSON.stringify([this.#floor, this.#goals, clientWidth, clientHeight]);
    if (seen !== this.#drawn) { this.#draw(); this.#drawn = seen; }
  }

  get hint() {
    return this.#goals.length ? "drag the goal, or double-click where it is to be" : "";
  }

  #fit() {
    const points = [
      ...(this.#floor?.places ?? []), ...this.#goals.map(({ x, y }) => [x, y]),
      ...this.#fixed.flatMap(([, outline]) => outline),
    ];
    if (!points.length) return;
    const xs = points.map(([x]) => x), ys = points.map(([, y]) => y);
    const now = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const old = this.#box ?? now; // it only grows: what one looks at keeps its place
    this.#box = [
      Math.min(old[0], now[0]), Math.max(old[1], now[1]), Math.min(old[2], now[2]), Math.max(old[3], now[3]),
    ];
  }

  #scale() {
    const [left, right, bottom, top] = this.#box ?? [-1, 1, -1, 1];
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    const span = (low, high) => Math.max(LEAST_M, high - low + 2 * MARGIN_M);
    const k = Math.min(width / span(left, right), height / span(bottom, top));
    const [cx, cy] = [(left + right) / 2, (bottom + top) / 2];
    return {
      k, toPixel: ([x, y]) => [width / 2 + k * (x - cx), height / 2 - k * (y - cy)],
      toWorld: (px, py) => [cx + (px - width / 2) / k, cy - (py - height / 2) / k],
    };
  }

  #draw() {
    if (this.#dragged === null) this.#fit();
    const canvas = this.#canvas, ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d"), scale = this.#scale();
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    this.#drawGrid(pen, scale, width, height);
    const outline = (points, color, fill) => {
      pen.beginPath();
      points.forEach((point) => pen.lineTo(...scale.toPixel(point)));
      pen.closePath();
      pen.fillStyle = color + fill; pen.fill(); pen.strokeStyle = color; pen.lineWidth = 1; pen.stroke();
    };
    this.#fixed.forEach(([, points]) => outline(points, COLORS.fixed, "55"));
    this.#trails.forEach((trail, i) => {
      pen.beginPath();
      trail.forEach((point) => pen.lineTo(...scale.toPixel(point)));
      pen.strokeStyle = (this.#frames[i] === "base" ? COLORS.robot : COLORS.thing) + "99"; pen.lineWidth = 1.5; pen.stroke();
    });
    this.#floor?.shapes.forEach(([whose, points]) => outline(points, COLORS[whose], "44"));
    this.#goals.forEach((goal) => this.#drawGoal(pen, scale, goal));
  }

  #drawGrid(pen, scale, width, height) {
    const [left, top] = scale.toWorld(0, 0), [right, bottom] = scale.toWorld(width, height);
    pen.lineWidth = 1; pen.font = "10px system-ui"; pen.fillStyle = "#717b8f";
    for (let i = Math.ceil(left / GRID_M); i <= right / GRID_M; i++) {
      const [x] = scale.toPixel([i * GRID_M, 0]);
      pen.strokeStyle = i % 2 ? "#20242c" : "#2c313c";
      pen.beginPath(); pen.moveTo(x, 0); pen.lineTo(x, height); pen.stroke();
      if (i % 2 === 0) pen.fillText(`${i * GRID_M} m`, x + 2, height - 3);
    }
    for (let i = Math.ceil(bottom / GRID_M); i <= top / GRID_M; i++) {
      const [, y] = scale.toPixel([0, i * GRID_M]);
      pen.strokeStyle = i % 2 ? "#20242c" : "#2c313c";
      pen.beginPath(); pen.moveTo(0, y); pen.lineTo(width, y); pen.stroke();
    }
  }

  #drawGoal(pen, scale, { name, x, y }) {
    const [px, py] = scale.toPixel([x, y]);
    pen.strokeStyle = "#4cc38a"; pen.fillStyle = "#4cc38a33"; pen.lineWidth = 2;
    pen.beginPath(); pen.arc(px, py, 10, 0, 2 * Math.PI); pen.fill(); pen.stroke();
    pen.beginPath(); pen.moveTo(px - 14, py); pen.lineTo(px + 14, py); pen.moveTo(px, py - 14); pen.lineTo(px, py + 14); pen.stroke();
    pen.fillStyle = "#9ff0c5"; pen.font = "11px system-ui"; pen.fillText(name, px + 13, py - 6);
  }

  #at(event) {
    const rect = this.#canvas.getBoundingClientRect();
    return [event.clientX - rect.left, event.clientY - rect.top];
  }

  #grab(event) {
    const [px, py] = this.#at(event), { toPixel } = this.#scale();
    const far = ({ x, y }) => { const [gx, gy] = toPixel([x, y]); return Math.hypot(gx - px, gy - py); };
    const nearest = [...this.#goals].sort((a, b) => far(a) - far(b))[0];
    if (nearest === undefined || far(nearest) > REACH_PX) return;
    this.#dragged = nearest;
    this.#canvas.setPointerCapture(event.pointerId);
  }

  #drag(event) { if (this.#dragged !== null) this.#tell(this.#dragged, event); }

  #put(event) { if (this.#goals.length) this.#tell(this.#goals[0], event); }

  #tell(goal, event) {
    const [x, y] = this.#scale().toWorld(...this.#at(event)).map((n) => Number(n.toFixed(3)));
    Object.assign(goal, { x, y });
    this.#draw();
    this.#move(goal.name, x, y);
  }
}
