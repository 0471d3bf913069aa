// A page that plays a planned motion by itself. Its data are in the page: 4 bytes, the length of a
// JSON text; the text; the empty tank; of each picture its posture and pixels; the states of all ticks.

const $ = id => document.getElementById(id);
const SLOTS = 256;   // pictures that are held at a time
const refresh = new Refresh();
let facts, drawer, motion, states, pictures, ticks, resident = new Map();
let played = 0, last = null, runs = false, frames = 0, missed = 0, waits = 0;

async function inflated(text) {
  const packed = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

function unpack(data) {
  const length = new DataView(data).getUint32(0, true);
  facts = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  let at = 4 + length;
  const take = bytes => data.slice(at, at += bytes);
  const tank = new Uint8Array(take(facts.width * facts.height * facts.channels));
  pictures = new Map(facts.pictures.map(one => [one.picture, {...one,
    posture: new Float32Array(take(4 * facts.posture)),
    pixels: new Uint8Array(take(one.width * one.height * (facts.channels + 1)))}]));
  ticks = new Float32Array(take(4 * facts.ticks * facts.fish * (STATE.posture + facts.posture)));
  return tank;
}

function rowOf(tick) {
  const size = facts.fish * (STATE.posture + facts.posture);
  return ticks.subarray(tick * size, (tick + 1) * size);
}

// Bring the pictures of a tick; those not needed for longest make room.
function bring(row) {
  for (let i = 0; i < row.length; i += STATE.posture + facts.posture) {
    for (const number of [row[i + STATE.picture], row[i + STATE.partner]]) {
      const one = pictures.get(number);
      if (!one) continue;
      let slot = resident.get(number);
      resident.delete(number);
      if (slot === undefined) {
        slot = resident.size;
        if (slot >= facts.slots) {
          const [[oldest, free]] = resident;
          resident.delete(oldest);
          slot = free;
        }
        drawer.picture(number, slot, one.width, one.height, one.line, one.posture, one.pixels);
      }
      resident.set(number, slot);
    }
  }
}

// Draw the motion at a time, ticks.
function paint(at) {
  const end = facts.ticks - 1, tick = Math.min(Math.floor(at), end), next = Math.min(tick + 1, end);
  for (const one of [tick, next, Math.min(next + 1, end)]) bring(rowOf(one));
  motion.keys = [{seq: 0, t: tick, states: rowOf(tick)}, {seq: 0, t: tick + 1, states: rowOf(next)}];
  motion.at(at, states);
  drawer.draw(states, facts.fish);
  drawer.gl.flush();
}

function frame(ms) {
  requestAnimationFrame(frame);
  if (document.hidden) return;
  const {ideal, dropped} = refresh.frame(ms), passed = last === null ? 0 : (ideal - last) / 1000;
  last = ideal;
  if (runs) {
    played += passed * facts.rate;
    frames += 1 + dropped; missed += dropped;
    if (played >= facts.ticks) { played = facts.loops ? played % facts.ticks : facts.ticks - 1; runs = facts.loops; }
    paint(played);
  }
  if (!$("info").hidden) {
    $("info").textContent = `${(played / facts.rate).toFixed(1)} s · ${(1000 / refresh.period).toFixed(1)} Hz · ${missed} of ${frames} frames dropped`;
  }
}

function resize() {
  const ratio = window.devicePixelRatio || 1;
  drawer.screen(Math.round(innerWidth * ratio), Math.round(innerHeight * ratio), ratio, null, null);
  paint(played);
}

function run(on) { runs = on; $("hint").hidden = on; document.body.classList.toggle("runs", on); }

function pressed(event) {
  if (event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key.toLowerCase();
  if (key === " ") { event.preventDefault(); run(!runs); }
  if (key === "r") { played = frames = missed = 0; paint(0); }
  if (key === "i") $("info").hidden = !$("info").hidden;
  if (key === "f") {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen({navigationUI: "hide"}).catch(() => {});
  }
}

async function start() {
  const tank = unpack(await inflated($("data").content.textContent));
  facts.slots = Math.max(SLOTS, 6 * facts.fish);  // two pictures a fish, of three ticks
  drawer = new Drawer($("glass"), $("floor"), facts, tank);
  motion = new Motion(facts.fish, STATE.posture + facts.posture, facts.rate);
  states = new Float32Array(facts.fish * (STATE.posture + facts.posture));
  $("glass").addEventListener("webglcontextlost", () => location.reload());
  addEventListener("resize", () => { clearTimeout(waits); waits = setTimeout(resize, 250); });
  addEventListener("keydown", pressed);
  document.addEventListener("visibilitychange", () => { refresh.rest(); last = null; });
  addEventListener("click", () => run(!runs));
  resize();
  requestAnimationFrame(frame);
}

start().catch(error => { $("hint").textContent = `This cannot be shown: ${error.message}`; });
