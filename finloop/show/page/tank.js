// A tank on a page: it takes the server's messages, and draws the fish at the rate of the display.
// A page adds to TAKE what it does with a message besides, and calls `advance` and `draw` in a frame.

const clock = new Clock(), refresh = new Refresh();
let hello = null, drawer = null, motion = null, states = null, last = null, number = 0, stale = true;

const TAKE = {
  hello(text, tank) {
    const same = hello && drawer && !drawer.lost && JSON.stringify(shapeOf(hello)) === JSON.stringify(shapeOf(text));
    hello = text;
    if (!same) begin(text, new Uint8Array(tank));
    motion?.hold(clock.at(performance.now()));
  },
  picture({picture, slot, width, height, line}, data) {
    const d = hello.posture;
    drawer?.picture(picture, slot, width, height, line, new Float32Array(data, 0, d), new Uint8Array(data, 4 * d));
    stale = true;
  },
  rows(text, data, now) { motion?.rows(text, new Float32Array(data), clock.at(now)); },
  clear() { motion?.clear(); },
  pong({sent, now: server}, _, now) {
    clock.ping(sent, server, now);
    if (!motion || !motion.keys.length) clock.settle();
  },
};

// Connect to a tank. more: what the page itself does with messages, by kind; opened(): it is connected.
function connectTank(path, more, {opened, closed = () => {}, again}) {
  const ping = () => link.tell({do: "ping", sent: performance.now(), frames: number});
  const link = new Link(path, {
    again,
    heard(data, now) {
      const [text, payload] = unpack(data);
      TAKE[text.kind]?.(text, payload, now);
      more[text.kind]?.(text, payload, now);
    },
    opened() {
      ping();  // the clock comes first: rows that follow are placed by it
      opened();
      for (let i = 1; i < 6; i++) setTimeout(ping, 40 * i);
    },
    closed(...why) { clock.renew(); closed(...why); },
  });
  link.ping = ping;
  return link;
}

// The facts of a hello whose change requires a fresh start.
function shapeOf({width: w, height, channels, posture, slots, slot_width, slot_height, looks, fish, rate,
  typical}) {
  return {w, height, channels, posture, slots, slot_width, slot_height, looks, fish, rate, typical};
}

function width() { return STATE.posture + hello.posture; }

function begin(text, tank) {
  const old = $("glass"), glass = old.cloneNode();
  old.replaceWith(glass);
  try {
    drawer = new Drawer(glass, $("floor"), text, tank);
  } catch (error) {
    cannotDraw(error.message);  // of the page
    throw error;
  }
  glass.addEventListener("webglcontextlost", event => { event.preventDefault(); drawer.lost = true; });
  glass.addEventListener("webglcontextrestored", () => restored());  // of the page
  motion = new Motion(text.fish, width(), text.rate);
  states = new Float32Array(text.fish * width());
  last = new Float32Array(states.length);
}

// Move the fish to the time, ms, at which the browser should have begun a frame; the number of the
// last rows that it shows.
function advance(ideal) {
  number += 1;
  return motion.at(clock.at(ideal), states);
}

// Draw the states of `count` fish where they have changed, or `anyway`.
function draw(count, anyway = false) {
  if (!stale && !anyway && states.every((part, i) => part === last[i])) return;
  drawer.draw(states, count);
  drawer.gl.flush();
  last.set(states);
  stale = false;
}
