// The experimenter's page: what happens, and what is to happen.

const canvas = $("map"), pen = canvas.getContext("2d");
const PHASES = {ready: "ready", planning: "planning", running: "running", pause: "pause", saving: "saving", done: "ended"};
const LATENCY = {planned_ms: "input to planned", drawn_ms: "input to drawn", tick_ms: "tick late by"};
const HEARD = {
  taken: "taken", outside: "taken, and moved into the tank", clock: "taken, though the tracker's clock jumped",
  rival: "refused: another tracker names the same animal", late: "refused: older than the last of this animal",
  malformed: "refused: no message", crowd: "refused: too many animals", unwanted: "refused: the protocol has no animals",
  flood: "refused: too many messages of one sender",
};
const NAMES = {" ": "the space bar", Enter: "the enter key"};
const TRAIL_S = 3;
let whole = {}, state = null, heardAt = 0, tried = false, refused = "", stopping = false, asking = null, cue = "", newest = "";
const trails = new Map();

// --- the server

function heard(data) {
  const now = JSON.parse(data);
  if (now.trials) { whole = now; roll(); trails.clear(); }
  state = now;
  if ("stopping" in now) stopping = now.stopping;
  heardAt = performance.now();
  tried = true;
  refused = "";
  tell();
}

function closed(code) {
  tried = true;
  refused = code === 1013 ? "Too many of these pages are open: close one." : "";
  if (state) tell();
  alarm();
}

const say = wish => link.tell(wish);
const live = () => link.isOpen && state && performance.now() - heardAt < 2000;

function alarm() {
  const text = refused || (live() || !tried ? "" : !heardAt ? "The session does not answer. Trying again …" : "No connection to the session for "
    + `${Math.round((performance.now() - heardAt) / 1000)} s. This page shows old data; the display goes on. Trying again …`);
  $("alarm").hidden = !text;
  set("alarm", text);
  set("status", live() ? "connected" : tried ? "not connected" : "connecting …");
  if (!live()) for (const id of ["start", "skip", "stop", "abort", "add"]) $(id).disabled = true;
}

// --- what is shown

const clock = s => {
  const all = Math.max(0, Math.round(s)), two = n => String(n).padStart(2, "0");
  return (all >= 3600 ? `${Math.floor(all / 3600)}:${two(Math.floor(all / 60) % 60)}` : Math.floor(all / 60)) + `:${two(all % 60)}`;
};
const many = n => n.toLocaleString("en");

function make(tag, text, kind) {
  const one = document.createElement(tag);
  if (text !== undefined) one.textContent = text;
  if (kind) one.className = kind;
  return one;
}

function roll() {
  document.title = `${whole.protocol} – finloop`;
  set("protocol", whole.protocol);
  set("facts", `seed ${whole.seed}${whole.file ? ` · ${whole.file}` : ""}${(whole.demands || []).length ? ` · requires ${whole.demands.join("; ")}` : ""}`);
  $("trials").replaceChildren(...whole.trials.map(([number, block, , condition, seconds]) => {
    const row = document.createElement("tr");
    row.append(make("td", number), make("td", condition, "text"), make("td", block), make("td", seconds), make("td", "", "text state"));
    return row;
  }));
  stopping = false; cue = "";
}

const isOver = () => ["saving", "done"].includes(state.phase);
const waited = () => state.start === "auto" ? "Start, as no display showed frames" : NAMES[state.start] || (state.start.length === 1 ? `the key ${state.start}` : `the message ${state.start}`);
const trial = () => whole.trials[state.trial];
const next = () => whole.trials[state.phase === "pause" || state.trial < 0 ? state.trial + 1 : state.trial];

function tell() {
  const {phase} = state, now = trial(), then = next();
  $("phase").className = `chip ${phase}`;
  set("phase", phase === "waiting" ? `waits for ${waited()}` : PHASES[phase] || phase);
  set("what", phase === "done" ? "The session has ended"
    : phase === "saving" ? "The trials are over; the session's file is being written"
    : phase === "ready" ? `${many(whole.trials.length)} trials, none begun${state.draws ? "" : "; they cannot start, as no display shows frames"}`
    : phase === "pause" ? (then ? `Next: trial ${then[0]}, ${then[3]}` : "After the last trial")
    : now ? `Trial ${now[0]} of ${whole.trials.length}: ${now[3]}` : "–");
  const left = state.left_s;
  set("left", left === null ? "" : clock(left));
  $("part").value = phase === "running" && left !== null && now ? Math.min(1, Math.max(0, 1 - left / now[4])) : isOver() ? 1 : 0;
  buttons(phase, now);
  states(phase);
  display();
  timing();
  listHeard();
  messages();
  map();
  alarm();
  announce(phase, now);
}

function buttons(phase, now) {
  const on = live(), runs = phase === "running", number = now ? now[0] : "";
  $("start").disabled = !on || !["ready", "waiting"].includes(phase);
  set("start", phase === "waiting" ? `Begin trial ${number}` : "Start");
  $("skip").disabled = !on || phase === "ready" || isOver() || (phase === "pause" && !next());
  set("skip", phase === "pause" ? "Next trial now" : runs ? `Skip the rest of trial ${number} …` : now && !isOver() && phase !== "ready" ? `Skip trial ${number}` : "Skip");
  $("stop").disabled = !on || stopping || phase === "ready" || isOver();
  $("stop").setAttribute("aria-pressed", stopping);
  set("stop", stopping && !isOver() ? "Stops after this trial" : "Stop after this trial");
  $("abort").disabled = !on || isOver();
  $("add").disabled = !on;
  if (asking?.wish.do === "skip" && asking.at !== `${state.trial} ${phase}`) $("ask").close("no");  // it was another trial that was asked about
}

const STATES = {done: "✓ done", skipped: "skipped", aborted: "aborted", running: "▶ now", next: "next", "": "–"};
function states(phase) {
  const rows = $("trials").rows, {done} = state;
  const at = phase === "pause" || phase === "ready" ? state.trial + 1 : state.trial;
  for (let i = 0; i < rows.length; i++) {
    const word = done[i + 1] || (isOver() ? "" : i === at ? (phase === "running" ? "running" : "next") : "");
    if (rows[i].dataset.state === word) continue;
    rows[i].dataset.state = word;
    rows[i].cells[4].textContent = STATES[word] || word;
    if (word === "running" || word === "next") {
      if (word === "running") rows[i].setAttribute("aria-current", "true");
      const box = $("rolls");
      box.scrollTop += rows[i].getBoundingClientRect().top - box.getBoundingClientRect().top - box.clientHeight / 3;
    } else rows[i].removeAttribute("aria-current");
  }
  const past = Object.values(done), left = whole.trials.slice(at).reduce((sum, one) => sum + one[4], 0);
  const odd = past.filter(word => word !== "done").length;
  set("count", `${past.length} of ${whole.trials.length}${odd ? `, ${odd} of them not whole` : ""}`
    + (isOver() || !left ? "" : `; ${clock(left)} of trials to come`));
}

function list(id, entries) {  // of a dl: name, value, whether it is a warning
  const key = JSON.stringify(entries), at = $(id);
  if (at.dataset.key === key) return;
  at.dataset.key = key;
  at.replaceChildren(...entries.flatMap(([name, value, warn]) => [make("dt", name), make("dd", value, warn ? "warn" : "")]));
}

function rows(id, entries, warn = []) {  // of a table: a word, then numbers; which rows are warnings
  const key = JSON.stringify(entries), at = $(id);
  if (at.dataset.key === key) return;
  at.dataset.key = key;
  at.replaceChildren(...entries.map(([name, ...numbers], i) => {
    const row = document.createElement("tr"), head = make("th", name, "text");
    head.scope = "row";
    row.append(head, ...numbers.map(number => make("td", number)));
    row.classList.toggle("warn", Boolean(warn[i]));
    return row;
  }));
}

function display() {
  const tank = state.screen ? [["tank", ...state.screen]] : [];
  const one = state.display;
  $("nodisplay").hidden = Boolean(one);
  if (!one) {
    const link = $("link"), safe = /^https?:\/\//.test(whole.link || "");
    set("link", whole.link || "the display's page");
    if (safe) link.href = whole.link; else link.removeAttribute("href");
    list("display", tank);
    return;
  }
  const size = `${one.width} × ${one.height} px` + (one.ratio && one.ratio !== 1 ? `, ${one.ratio} device px a CSS px` : "");
  const wanted = whole.calibrated && !one.calibrated;
  list("display", [
    ["name", one.name || "–"], ["size", size], ["drawn by", one.renderer || "not known"],
    ["refresh rate", one.refresh_hz ? `${one.refresh_hz.toFixed(2)} Hz` : "not known"],
    ["calibrated", one.calibrated ? "yes" : wanted ? "no, but the protocol demands it" : "no", !one.calibrated],
    ...tank,
    ...(state.draws || one.hidden || isOver() ? [] : [["frames", `none come: ${state.phase === "running" ? "fish may be unseen" : "no trial can start"}`, true]]),
    ...(one.hidden ? [["page", "hidden behind another window: nothing is drawn", true]] : []),
    ...(state.displays > 1 ? [["pages", `${state.displays} show the session: this one is logged, the others mirror it`, true]] : []),
  ]);
}

function timing() {
  rows("latency", Object.entries(LATENCY).map(([key, name]) => {
    const pair = state.latency[key];
    return [name, ...(pair ? pair.map(ms => ms.toFixed(1)) : ["–", "–"])];
  }));
  const share = state.frames ? ` (${(100 * state.dropped / (state.frames + state.dropped)).toFixed(2)} %)` : "";
  set("frames", `${many(state.frames)} frames drawn · ${many(state.dropped)} dropped${share} · ${many(state.late)} late`);
  $("frames").classList.toggle("warn", state.dropped + state.late > 0);
}

function listHeard() {
  const known = Object.keys(HEARD), place = word => (known.indexOf(word) + known.length + 1) % (known.length + 1);  // unknown ones first
  const entries = Object.entries(state.heard).sort(([a], [b]) => place(a) - place(b));
  $("unheard").hidden = entries.length > 0;
  $("heard").closest(".wide").hidden = !entries.length;
  rows("heard", entries.map(([word, count]) => [HEARD[word] || word, many(count)]), entries.map(([word]) => word !== "taken"));
}

function messages() {
  const key = JSON.stringify(state.messages), at = $("log");
  if (key === newest) return;
  newest = key;
  $("quiet").hidden = state.messages.length > 0;
  at.hidden = !state.messages.length;
  at.replaceChildren(...[...state.messages].reverse().map(text => make("li", text)));
}

function announce(phase, now) {
  const key = `${state.trial} ${phase}`;
  if (key === cue) return;
  cue = key;
  if (phase === "running" && now) $("told").textContent = `Trial ${now[0]}, ${now[3]}, runs.`;
  else if (phase === "waiting" && now) $("told").textContent = `Trial ${now[0]} waits.`;
  else if (phase === "done") $("told").textContent = "The session has ended, and its file is written.";
}

// --- the map

const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name);
const isLost = animal => animal[5] === undefined ? animal[4] > (whole.gap_s || 0.5) : animal[5];

function map() {
  const [w, h] = whole.tank, ratio = Math.min(window.devicePixelRatio || 1, 2);
  const fit = Math.min(canvas.parentElement.clientWidth / w, innerHeight * 0.52 / h), scale = fit * ratio;
  const wide = Math.max(1, Math.round(w * scale)), high = Math.max(1, Math.round(h * scale));
  if (canvas.width !== wide || canvas.height !== high) {
    canvas.width = wide; canvas.height = high;
    canvas.style.width = wide / ratio + "px"; canvas.style.height = high / ratio + "px";
  }
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.fillStyle = colour("--glass"); pen.fillRect(0, 0, wide, high);
  pen.setTransform(scale, 0, 0, scale, scale / 2, scale / 2);
  pen.lineJoin = pen.lineCap = "round";
  const unit = 1 / fit, tones = {fish: colour("--accent"), animal: colour("--taken"), lost: colour("--bad"), ink: colour("--ink"), glass: colour("--glass")};
  pen.globalAlpha = 0.5; pen.strokeStyle = tones.lost; pen.lineWidth = unit;
  pen.strokeRect(-0.5 + unit / 2, -0.5 + unit / 2, w - unit, h - unit);  // the tank's edge
  pen.globalAlpha = 1;
  if (whole.mm_per_px) bar(w, h, unit, tones);
  keep(state.fish.map((one, i) => [`fish ${i}`, one[0], one[1], 2 * one[3]]).concat(
    state.animals.filter(one => !isLost(one)).map(one => [`animal ${one[0]}`, one[1], one[2], Infinity])));
  for (const [name, places] of trails) trail(places, name.startsWith("fish") ? tones.fish : tones.animal, unit);
  for (const one of state.fish) fish(one, unit, tones);
  for (const one of state.animals) animal(one, unit, tones);
  const lost = state.animals.filter(isLost).length;
  set("summary", `${state.fish.length} fish shown, ${state.animals.length} live animals${lost ? `, ${lost} lost` : ""}`);
}

function keep(places) {  // what was where in the last seconds; one that jumps begins anew
  const names = new Set(places.map(([name]) => name));
  for (const name of trails.keys()) if (!names.has(name)) trails.delete(name);
  for (const [name, x, y, far] of places) {
    const old = (trails.get(name) || []).filter(place => place[2] > state.now - TRAIL_S && place[2] <= state.now), last = old[old.length - 1];
    if (last && Math.hypot(last[0] - x, last[1] - y) > far) old.length = 0;
    if (!last || last[2] < state.now) old.push([x, y, state.now]);
    trails.set(name, old);
  }
}

function trail(places, tone, unit) {
  pen.strokeStyle = tone; pen.lineWidth = 1.6 * unit; pen.lineCap = "butt";
  for (let i = 1; i < places.length; i++) {
    pen.globalAlpha = 0.6 * (1 - (state.now - places[i][2]) / TRAIL_S);
    pen.beginPath(); pen.moveTo(places[i - 1][0], places[i - 1][1]); pen.lineTo(places[i][0], places[i][1]); pen.stroke();
  }
  pen.globalAlpha = 1; pen.lineCap = "round";
}

function fish([x, y, heading, size, alpha], unit, tones) {
  const long = Math.max(size, 16 * unit) / 2;
  pen.save();
  pen.translate(x, y); pen.rotate(-heading); pen.scale(long, long);
  pen.globalAlpha = 0.15 + 0.85 * alpha;
  pen.beginPath();
  pen.moveTo(1, 0); pen.quadraticCurveTo(.25, -.5, -.55, -.08); pen.lineTo(-1, -.32); pen.lineTo(-1, .32);
  pen.lineTo(-.55, .08); pen.quadraticCurveTo(.25, .5, 1, 0); pen.closePath();
  pen.fillStyle = tones.fish; pen.fill();
  pen.restore();
}

function animal([id, x, y, heading, age, ...rest], unit, tones) {
  const lost = isLost([id, x, y, heading, age, ...rest]), radius = 9 * unit, tone = lost ? tones.lost : tones.animal;
  pen.strokeStyle = tone; pen.lineWidth = (lost ? 1.8 : 2.6) * unit;
  pen.setLineDash(lost ? [4 * unit, 5 * unit] : []);
  pen.beginPath(); pen.arc(x, y, radius, 0, 7); pen.stroke();
  pen.setLineDash([]);
  if (heading !== null) {
    const dx = Math.cos(heading), dy = -Math.sin(heading);
    pen.beginPath(); pen.moveTo(x + dx * radius, y + dy * radius); pen.lineTo(x + 2 * dx * radius, y + 2 * dy * radius); pen.stroke();
  }
  const name = String(id).length > 14 ? String(id).slice(0, 13) + "…" : String(id);
  label(lost ? `${name}, lost for ${age.toFixed(0)} s` : name, x + 14 * unit, y - 13 * unit, unit, tone, tones.glass);
}

function label(text, x, y, unit, tone, edge) {
  pen.font = `600 ${13 * unit}px system-ui, sans-serif`;
  const wide = pen.measureText(text).width;
  if (x + wide > whole.tank[0]) x = Math.max(0, x - wide - 28 * unit);
  pen.textBaseline = "middle"; pen.lineWidth = 4 * unit; pen.strokeStyle = edge;
  y = Math.max(y, 9 * unit);
  pen.strokeText(text, x, y); pen.fillStyle = tone; pen.fillText(text, x, y);
}

function bar(w, h, unit, tones) {
  const long = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].filter(mm => mm / whole.mm_per_px <= w / 4).pop();
  if (!long) return;
  const x = 12 * unit, y = h - 14 * unit;
  pen.strokeStyle = tones.ink; pen.lineWidth = 2 * unit;
  pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + long / whole.mm_per_px, y); pen.stroke();
  label(`${long} mm`, x, y - 12 * unit, unit, tones.ink, tones.glass);
}
addEventListener("resize", () => state && map());

// --- buttons and keys

function ask(text, yes, wish) {
  asking = {at: `${state.trial} ${state.phase}`, wish};
  set("asked", text); set("yes", yes);
  $("ask").returnValue = "no";
  $("ask").showModal();
}
$("ask").onclose = () => {
  const wanted = asking;
  asking = null;
  if (wanted && $("ask").returnValue === "yes") say(wanted.wish);
};

$("start").onclick = () => say({do: "start"});
$("stop").onclick = () => { if (say({do: "stop"})) { stopping = true; tell(); } };
$("abort").onclick = () => {
  ask(state.phase === "running" ? `Abort the session now? The fish vanish at once, and a trial that runs then counts as aborted.`
    : "Abort the session now? No further trial is shown.", "Abort now", {do: "abort"});
};
$("skip").onclick = () => {
  if (state.phase !== "running") say({do: "skip"});
  else ask(`Skip the rest of trial ${trial()[0]}? The fish vanish at once, and it counts as skipped.`, "Skip it", {do: "skip"});
};
$("form").onsubmit = event => {
  event.preventDefault();
  const text = $("note").value.trim();
  if (!text) return;
  if (say({do: "note", text})) { $("note").value = ""; set("said", `noted at ${state.now.toFixed(1)} s`); }
  else set("said", "not noted: no connection");
};
$("note").onkeydown = event => { if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) $("form").requestSubmit(); };
$("note").oninput = () => set("said", "Ctrl + Enter adds it");

const KEYS = {s: "start", k: "skip", e: "stop", a: "abort", n: "note"};
addEventListener("keydown", event => {
  const at = event.target;
  if (!state || event.ctrlKey || event.metaKey || event.altKey || event.repeat || $("ask").open || at.tagName === "TEXTAREA") return;
  if (state.phase === "waiting" && event.key === state.start) {  // as before the display; a button takes its own keys
    if ((event.key === " " || event.key === "Enter") && ["BUTTON", "INPUT", "A"].includes(at.tagName)) return;
    say({do: "key", key: event.key});
  } else {
    const id = KEYS[event.key.toLowerCase()];
    if (!id || !$("keys").checked) return;
    if (id === "note") $("note").focus(); else $(id).click();
  }
  event.preventDefault();
});

const link = new Link("/experimenter", {heard, closed});
setInterval(alarm, 500);
