// The display's page: it draws what the server plans, and reports what was shown when.

const EVERY_MS = 180;         // the shortest time between two messages with records
const MOST_BYTES = 48 * 1024;  // of a message to the server
const KEPT = 4096;            // records that wait while the connection is lost
const EMPTY_MS = 1000;        // after coming back without any rows, the fish are gone
const HEADER = 8;             // numbers of a record before its states

let link = null, panel = null, display = null, lastDigest = 0, dropped = 0, begun = false, noted = false;
let records = [], sentAt = 0, said = "", emptied = 0;

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen({navigationUI: "hide"}).catch(() => {});
}

function screenNow() {
  const ratio = window.devicePixelRatio || 1;
  return {width: Math.round(innerWidth * ratio), height: Math.round(innerHeight * ratio), ratio,
    refresh: Math.round(1e5 / refresh.period) / 100};
}

function renderer() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return "none";
  const known = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(known ? known.UNMASKED_RENDERER_WEBGL : gl.RENDERER)).slice(0, 400);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}
const RENDERER = renderer();
// The identity of this page: the display stays the same if its window or its connection changes.
const PAGE = Array.from(crypto.getRandomValues(new Uint32Array(4)), word => word.toString(36)).join("-");

// --- the server

function ready() {
  const {width, height, ratio} = screenNow();
  link.tell({do: "ready", page: PAGE, width, height, ratio, renderer: RENDERER, agent: navigator.userAgent.slice(0, 400)});
}

function resized() {
  const {width, height, ratio} = screenNow();
  link.tell({do: "resized", width, height, ratio});
}

// A stimulus does not report a lost connection: it shows what it has, and reconnects.
function opened() {
  ready();
  link.tell({do: "hidden", on: document.hidden});
}

const MORE = {
  hello(text) {
    emptied = performance.now() + EMPTY_MS;
    display = text.display;
    resize();
    panel.set(display, text.name, text.mm_per_px);
    document.body.dataset.mode = text.mode;
    if (text.mode === "calibrate" && !panel.isOpen) panel.open(true);
    showSay();
  },
  picture() { if (emptied) emptied = performance.now() + EMPTY_MS; },  // rows come after all pictures
  rows() {
    if (!begun) { begun = true; panel.open(false); }
    emptied = 0;
  },
  clear() { emptied = 0; },
  frame({number: of}, data) {
    const now = performance.now();
    states.fill(0);
    states.set(new Float32Array(data));
    number = of;
    stale = true;
    show(Math.min(data.byteLength / 4 / width(), hello.fish), now, now, 0);
    flush(now);
  },
  say({text}) { said = text; showSay(); },
};

function cannotDraw(reason) { said = `This display cannot show fish: ${reason}`; showSay(); }
function restored() { ready(); }

// --- frames

function frame(ms) {
  requestAnimationFrame(frame);
  if (document.hidden) return;
  const {ideal, dropped: missed} = refresh.frame(ms);
  if (!drawer || hello.mode === "replay") return;
  if (emptied && ms > emptied) { emptied = 0; motion.clear(); }
  const known = motion.keys.length > 0;
  dropped = known ? dropped + missed : 0;
  const seq = advance(ideal);
  show(known ? hello.fish : 0, ms, ideal, seq);
  if (ms - sentAt > EVERY_MS) flush(ms);
  if (number % 30 === 0) link.ping();  // also the report that frames are drawn
}

// Draw the states, and note it. ms: when the browser began the frame; ideal: when it should have.
function show(count, ms, ideal, seq) {
  draw(count, hello.digest);
  if (drawer.square) drawer.square.style.background = number % 2 ? "#fff" : "#000";
  const done = performance.now();
  lastDigest = hello.digest ? drawer.digest(number % 2) : 0;
  const before = noted;
  noted = count > 0 || hello.mode === "replay";
  if (!noted && !before) return;  // nothing is visible, nor was before
  const record = new Float64Array(HEADER + Math.ceil(count * width() / 2));
  record.set([number, clock.at(ideal), clock.at(ms), clock.at(done), seq, dropped, count, lastDigest]);
  new Float32Array(record.buffer, 8 * HEADER).set(states.subarray(0, count * width()));
  records.push(record);
  dropped = 0;
  if (records.length > KEPT) records.shift();
}

// Send the records of the frames that were shown.
function flush(ms) {
  sentAt = ms;
  if (!link.isOpen) return;
  while (records.length) {
    const some = [];
    let bytes = 0;
    while (records.length && (!some.length || bytes + records[0].byteLength <= MOST_BYTES)) {
      bytes += records[0].byteLength; some.push(records.shift());
    }
    const whole = new Uint8Array(bytes);
    let at = 0;
    for (const one of some) { whole.set(new Uint8Array(one.buffer), at); at += one.byteLength; }
    link.tell(whole);
  }
}

// --- the screen

function drawBy(one) {
  display = one;
  if (!drawer) return;
  const {width: w, height, ratio} = screenNow();
  drawer.screen(w, height, ratio, one, hello.mm_per_px);
  const square = $("square"), wanted = one && one.square;
  square.hidden = !wanted;
  drawer.square = wanted ? square : null;
  if (wanted) {
    const [up, side] = wanted.corner.split(" "), size = `${wanted.size_px / ratio}px`;
    square.style.cssText = `${up}: 0; ${side}: 0; width: ${size}; height: ${size}; background: #000`;
  }
  stale = true;
}

function resize() { drawBy(display); }

function showSay() {
  const {width: w, height} = screenNow(), known = hello && hello.display;
  const other = known && (known.width_px !== w || known.height_px !== height);
  const warn = other && (said || hello.mode === "calibrate")
    ? `calibrated at ${known.width_px} × ${known.height_px} px, now ${w} × ${height}: press F for full screen` : "";
  $("said").textContent = said; $("warn").textContent = warn;
  $("say").hidden = !(said || (warn && !panel.isOpen));
}

let waits = 0;
addEventListener("resize", () => { clearTimeout(waits); waits = setTimeout(() => { resize(); showSay(); resized(); }, 250); });
document.addEventListener("visibilitychange", () => { refresh.rest(); link.tell({do: "hidden", on: document.hidden}); });
addEventListener("keydown", event => {
  if (event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  if (panel.isOpen && event.target.matches("input, select, textarea") && event.key !== "Escape") return;
  if (hello && hello.keys.includes(event.key)) {
    link.tell({do: "key", key: event.key});
    if (event.key === " " && !panel.isOpen) event.preventDefault();
    return;
  }
  const key = event.key.toLowerCase();
  if (key === "f") fullScreen();
  if (key === "escape" && panel.isOpen) panel.open(false);
  if (key === "c" && hello && !begun && hello.mode !== "replay") panel.open(!panel.isOpen);
  if (key === "t" && panel.isOpen) panel.test();
});

panel = new Panel(screenNow, drawBy, one => link.tell({do: "display", display: one}));
link = connectTank("/display", MORE, {opened, again: 500});
requestAnimationFrame(frame);
