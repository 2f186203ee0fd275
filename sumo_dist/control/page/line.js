// The line to the control service: pictures come, commands go, and each is answered.

const AGAIN_MS = 1000;
const DEAD_MS = 3000; // pictures come ten times a second

export class Line {
  #socket; #waiting = new Map(); #number = 0; #heard = 0; #hear;

  // hear: {steers, offer, picture, lost} of functions
  constructor(hear) {
    this.#hear = hear;
    this.#open();
    setInterval(() => this.#watch(), 500);
  }

  // Returns what came of the command: {refusal, tick}; refusal is "" if it was carried out.
  async give(verb, name = "", value = "") {
    if (this.#socket.readyState !== WebSocket.OPEN) return { refusal: "there is no line to the control service" };
    const id = ++this.#number;
    this.#socket.send(JSON.stringify({ id, verb, name, value: String(value) }));
    return new Promise((resolve) => this.#waiting.set(id, resolve));
  }

  #open() {
    this.#socket = new WebSocket(new URL("live", location.href.replace(/^http/, "ws")));
    this.#socket.onmessage = (event) => this.#take(JSON.parse(event.data));
    this.#socket.onclose = () => {
      for (const resolve of this.#waiting.values()) resolve({ refusal: "the control service is gone" });
      this.#waiting.clear();
      this.#hear.lost();
      setTimeout(() => this.#open(), AGAIN_MS);
    };
  }

  #take(message) {
    this.#heard = performance.now();
    if (message.steers !== undefined) this.#hear.steers(message.steers);
    if (message.offer) this.#hear.offer(message.offer);
    if (message.picture) this.#hear.picture(message.picture);
    if (message.answer) {
      this.#waiting.get(message.answer.id)?.(message.answer);
      this.#waiting.delete(message.answer.id);
    }
  }

  #watch() {
    if (this.#socket.readyState === WebSocket.OPEN && performance.now() - this.#heard > DEAD_MS) {
      this.#hear.lost();
    }
  }
}

// Makes of a function that sends a value and waits for its answer one that may be called at any
// rate: while one value is on its way, only the newest waits. Every call gets its answer's refusal.
export function newest(send) {
  let going = null, next = null;
  const go = async (value) => {
    const refusal = await send(value);
    if (next !== null) {
      const then = next;
      next = null;
      going = go(then.value);
      going.then(then.resolve);
    } else {
      going = null;
    }
    return refusal;
  };
  return (value) => {
    if (going === null) return (going = go(value));
    next?.resolve(""); // overtaken
    return new Promise((resolve) => { next = { value, resolve }; });
  };
}
