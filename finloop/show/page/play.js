// The page of the live tank: fish to send, their past to look at, and why they swim as they do.

const tank = $("tank"), ways = $("ways"), pen = ways.getContext("2d");
const FAILS = {"tank": "leaves, or ends", "quadrant": "leads away", "heading": "heads away", "passed over": "passed over"};
const MOST_PLACES = 500;  // of a path, as many as the tank accepts
const RIPPLE_MS = 700, FOLLOW_MS = 250, MOST_ZOOM = 8;
const mode = name => state.modes.find(one => one.name === name);
let state = null, parts = {}, who = 0, drag = null, pending = null, shown = "", told = {}, held = 0, weighed = 0, stroke = null, lined = "";
let zoom = 1, centre = null, follows = false, ripples = [], dirty = false, before = 0, seen = [];

const say = wish => link.tell(wish);

// --- the server

const MORE = {
  hello({width: w, height}) { centre ||= [w / 2, height / 2]; resize(); },
  modes({modes}) { parts.modes = modes; },
  decision({decision}) { parts.decision = decision; },
  events({events}) { parts.events = events; },
  tank({tank: now}) {
    state = {...now, ...parts};
    dirty = true;
    tell();
  },
};
const link = connectTank("/tank", MORE, {
  opened() { set("status", "connected"); },
  closed(code, reason) { set("status", reason === "too many" ? "too many pages are open; close one" : "the tank is closed; trying again …"); },
});

function cannotDraw(reason) {
  $("lacks").hidden = false;
  set("lacks", `The fish cannot be drawn: ${reason}. Open this page in a browser with WebGL 2, such as Chrome, Edge or Firefox with graphics acceleration on.`);
}
function restored() { link.socket.close(); }  // it comes back, and gets all pictures

// --- the view

// The tank fills its place on the page.
function resize() {
  const {width: w, height} = hello, ratio = Math.min(devicePixelRatio || 1, 2);
  const fits = Math.min(tank.parentElement.clientWidth / w, innerHeight * 0.74 / height);
  const wide = Math.round(w * fits * ratio), high = Math.round(height * fits * ratio);
  for (const one of [tank, ways]) { one.style.width = `${wide / ratio}px`; one.style.height = `${high / ratio}px`; }
  if (ways.width !== wide || ways.height !== high) { ways.width = wide; ways.height = high; }
  if (!drawer) return;
  drawer.screen(wide, high, ratio, null, null);
  aim();
}

// Look at the tank around `centre`, as large as `zoom` says, and not beyond its edges.
function aim() {
  const {whole} = drawer, {width: w, height} = hello, scale = whole.scale * zoom;
  const edge = (at, size, screen) => Math.min(0, Math.max(screen - size * scale, screen / 2 - (at + 0.5) * scale));
  const left = edge(centre[0], w, whole.width), top = edge(centre[1], height, whole.height);
  const {view} = drawer;
  if (drawer.aimed && view.scale === scale && view.left === left && view.top === top) return;
  drawer.aim(scale, left, top);
  centre = [(whole.width / 2 - left) / scale - 0.5, (whole.height / 2 - top) / scale - 0.5];
  stale = dirty = true;
}

// Zoom about a place of the screen, px of the device from the tank's corner: it stays where it is.
function zoomBy(times, sx = ways.width / 2, sy = ways.height / 2) {
  if (!drawer) return;
  const {view} = drawer, [x, y] = [(sx - view.left) / view.scale, (sy - view.top) / view.scale];
  zoom = Math.min(Math.max(zoom * times, 1), MOST_ZOOM);
  const scale = drawer.whole.scale * zoom;
  if (!follows) centre = [x + (ways.width / 2 - sx) / scale - 0.5, y + (ways.height / 2 - sy) / scale - 0.5];
  aim();
  $("nearer").disabled = zoom === MOST_ZOOM; $("farther").disabled = zoom === 1;
}

// Where fish i is drawn just now, px of the tank; null where it is not.
function drawnAt(i) {
  const at = i * width();
  return i >= 0 && i < hello.fish && states[at + STATE.picture] >= 0 ? [states[at], states[at + 1]] : null;
}

function followFish(passed) {
  const place = drawnAt(who < 0 ? state.explained : who);
  if (!place) return;
  const share = 1 - Math.exp(-passed / FOLLOW_MS);
  centre = centre.map((at, axis) => at + share * (place[axis] - at));
  aim();
}

function setFollow(on) {
  follows = on;
  $("follow").setAttribute("aria-pressed", on);
  if (on && zoom < 2) zoomBy(3 / zoom);
}

// --- frames

function frame(ms) {
  requestAnimationFrame(frame);
  if (document.hidden || !drawer || drawer.lost) return;
  const {ideal} = refresh.frame(ms);
  advance(ideal);
  if (follows && state) followFish(ms - before);
  before = ms;
  draw(hello.fish);
  if (state) {
    moveNames();
    if (dirty || ripples.length) paint(ms);
  }
  seen.push(ms);
  while (seen[0] < ms - 1000) seen.shift();
  if (number % 60 === 0) link.ping();
}

function line(points, colour, width, dash) {
  if (points.length < 2) return;
  pen.beginPath();
  points.forEach(([x, y], i) => i ? pen.lineTo(x, y) : pen.moveTo(x, y));
  pen.setLineDash(dash || []);
  pen.lineWidth = width; pen.strokeStyle = colour; pen.stroke();
  pen.setLineDash([]);
}

// What is under the fish: where they came from and swim to, and what was weighed.
function paint(ms) {
  const {view, whole, ratio} = drawer, {scale, left, top} = view;
  const unit = Math.max(Math.max(hello.height, hello.width) / 900, 0.8 * ratio / whole.scale) * whole.scale / scale;
  dirty = false;
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, ways.width, ways.height);
  pen.setTransform(scale, 0, 0, scale, left + scale / 2, top + scale / 2);
  pen.lineJoin = pen.lineCap = "round";
  for (const fish of state.fish) if (fish) trail(fish, unit);
  if ($("draw").checked && state.decision) drawCandidates(state.decision, unit);
  state.fish.forEach((fish, i) => { if (fish && fish.path) path(fish.path, unit, i === who || who < 0); });
  if (stroke) line(stroke, "#141414", 5 * unit), line(stroke, "#ffbe28", 2.5 * unit);
  state.fish.forEach((fish, i) => {
    if (fish && fish.goal) goal(fish.goal, String.fromCharCode(65 + i), unit, i === who || who < 0);
  });
  ripples = ripples.filter(({at}) => ms - at < RIPPLE_MS);
  for (const one of ripples) ripple(one, Math.max(0, ms - one.at) / RIPPLE_MS, unit);
  dirty = ripples.length > 0;
}

// Two rings that spread from where a goal was set, and fade.
function ripple({x, y}, part, unit) {
  for (const later of [0, 0.25]) {
    const share = (part - later) / (1 - later);
    if (share < 0) continue;
    pen.globalAlpha = 1 - share;
    pen.beginPath(); pen.arc(x, y, (6 + 46 * Math.sqrt(share)) * unit, 0, 7);
    pen.lineWidth = 2.5 * unit; pen.strokeStyle = "#ffffff"; pen.stroke();
  }
  pen.globalAlpha = 1;
}

function trail(fish, unit) {
  // not over the fish itself
  const points = fish.trail.filter(([x, y]) => Math.hypot(x - fish.x, y - fish.y) > 1.6 * state.touch), parts = 6;
  for (let i = 0; i < parts; i++) {  // it fades away behind
    const part = points.slice(Math.floor(i * points.length / parts), Math.floor((i + 1) * points.length / parts) + 1);
    pen.globalAlpha = (i + 1) / parts * 0.9;
    line(part, "#0007", 4 * unit);
    line(part, mode(fish.mode).colour, 2.2 * unit);
  }
  pen.globalAlpha = 1;
}

function drawCandidates(decision, unit) {
  const start = [decision.x, decision.y];
  const order = [...decision.candidates].reverse();
  for (const candidate of order) {
    const fails = candidate.fails !== "" && !candidate.taken;
    line(candidate.path, "#0008", (candidate.taken ? 6 : 3.5) * unit, fails ? [7 * unit, 6 * unit] : null);
    line(candidate.path, candidate.taken ? "#ffb000" : fails ? "#c3ced3" : "#35c9a5", (candidate.taken ? 3.5 : 1.8) * unit,
      fails ? [7 * unit, 6 * unit] : null);
  }
  pen.beginPath(); pen.arc(...start, 4 * unit, 0, 7); pen.fillStyle = "#000a"; pen.fill();
  pen.beginPath(); pen.arc(...start, 2.5 * unit, 0, 7); pen.fillStyle = "#fff"; pen.fill();
}

function path({places, closed, begun}, unit, mine) {
  const points = closed ? [...places, places[0]] : places, dash = begun ? null : [9 * unit, 8 * unit];
  pen.globalAlpha = begun ? 0.4 : 0.8;  // the fish stays visible through it
  line(points, "#141414", (mine ? 4 : 3) * unit, dash);
  line(points, "#ffbe28", (mine ? 2 : 1.2) * unit, dash);
  pen.globalAlpha = 1;
}

function goal([x, y, reached], name, unit, mine) {
  const radius = Math.max(state.touch, 8 * unit);
  for (const [colour, width] of [["#141414", 6], [reached ? "#ffffff" : "#ffbe28", mine ? 3 : 1.8]]) {
    pen.beginPath(); pen.arc(x, y, radius, 0, 7);
    pen.lineWidth = width * unit; pen.strokeStyle = colour; pen.stroke();
  }
  write(reached ? name + " ✓" : name, x + radius + 6 * unit, y, 17 * unit, reached ? "#ffffff" : "#ffbe28");
}

// The number of each fish goes with it, over the fish; a fish alone has none.
function moveNames() {
  const box = $("names"), count = state.fish.length > 1 ? state.fish.length : 0, {view, ratio} = drawer;
  if (box.children.length !== count) {
    box.replaceChildren(...state.fish.slice(0, count).map((_, i) => {
      const name = document.createElement("span");
      name.textContent = i + 1;
      return name;
    }));
  }
  [...box.children].forEach((name, i) => {
    const at = drawnAt(i);
    name.hidden = !at;
    name.className = i === state.explained ? "mine" : "";
    if (!at) return;
    const [x, y] = onScreen(view, ...at);
    name.style.transform = `translate(${x / ratio}px, ${y / ratio}px)`;
  });
}

function write(text, x, y, size, colour) {
  pen.font = `700 ${size}px system-ui, sans-serif`;
  const wide = pen.measureText(text).width;
  if (x + wide > hello.width) x = Math.max(0, x - wide - 2 * state.touch - 2 * size);
  pen.textBaseline = "middle"; pen.lineWidth = size / 4; pen.strokeStyle = "#141414";
  pen.strokeText(text, x, y); pen.fillStyle = colour; pen.fillText(text, x, y);
}

function tell() {
  const seconds = t => (t / state.rate).toFixed(1) + " s";
  $("badge").className = state.past ? "past" : "";
  set("badge", state.past ? `rewound by ${state.now - state.tick} ticks, ${seconds(state.now - state.tick)}` : state.paused ? "paused" : "live");
  const halted = !state.runs;
  set("pause", !halted ? "Pause" : state.past ? "Play on" : "Swim on");
  $("pause").classList.toggle("on", halted);
  timeLine();
  futures();
  $("live").disabled = $("from").disabled = !state.past;
  const scrub = $("scrub");
  scrub.min = state.oldest; scrub.max = state.now;
  if (performance.now() > held) scrub.value = state.tick;
  scrub.setAttribute("aria-valuetext", state.past ? `${seconds(state.now - state.tick)} ago` : "now");
  set("time", seconds(state.tick));
  modes();
  if (document.activeElement !== $("speed")) $("speed").value = String(state.speed);
  people();
  company();
  because();
  set("status", halted ? "stopped" : `${(state.rate * state.speed).toFixed(0)} ticks a second`);
  set("numbers", `${seen.length} frames a second · goals reached: ${state.reached} · ${state.ms.toFixed(0)} ms a tick · bad messages: ${state.bad}`);
  announce();
}

// What happened, over the time bar: a strip in the colour of the mode, a line for each transition of
// the fish, a disc for each goal.
function timeLine() {
  const at = $("line"), ratio = devicePixelRatio || 1, wide = Math.round(at.clientWidth * ratio), high = Math.round(16 * ratio);
  const key = JSON.stringify([wide, state.oldest, state.now - state.now % 8, state.explained, state.events]);
  if (key === lined) return;
  lined = key;
  at.width = wide; at.height = high;
  const ink = at.getContext("2d"), css = getComputedStyle(document.documentElement);
  const x = tick => (tick - state.oldest) / Math.max(1, state.now - state.oldest) * wide;
  const ended = state.events.filter(([, what]) => mode(what));
  ended.forEach(([tick, name], i) => {
    ink.fillStyle = mode(name).colour;
    const left = Math.max(0, x(tick));
    ink.fillRect(left, high - 3 * ratio, (i + 1 < ended.length ? x(ended[i + 1][0]) : wide) - left, 3 * ratio);
  });
  for (const [tick, what] of state.events) {
    if (tick < state.oldest) continue;
    if (what === "jump") { ink.fillStyle = css.getPropertyValue("--soft"); ink.fillRect(x(tick), 6 * ratio, ratio, 6 * ratio); }
    if (what === "goal") { ink.fillStyle = css.getPropertyValue("--taken"); ink.beginPath(); ink.arc(x(tick), 4 * ratio, 3.5 * ratio, 0, 7); ink.fill(); }
  }
}

// A button for each future that was left.
function futures() {
  const key = JSON.stringify(state.futures), at = $("futures");
  if (at.dataset.key === key) return;
  at.dataset.key = key;
  at.replaceChildren(...state.futures.map(([since, end], i) => {
    const button = document.createElement("button");
    button.textContent = `Back to the future left at ${(since / state.rate).toFixed(1)} s (until ${(end / state.rate).toFixed(1)} s)`;
    button.onclick = () => say({do: "return", future: i});
    return button;
  }));
}

// A bar for each part of the cost: of what was taken, and of the best that was not.
const TERMS = ["seams", "repeat", "rarity", "lag", "path", "time", "to come"];
function costBars(candidates) {
  const costs = candidates.filter(one => one.value !== null), taken = costs.find(one => one.taken);
  const other = costs.filter(one => !one.taken).sort((a, b) => a.value - b.value)[0];
  const pair = taken ? [taken, other].filter(Boolean) : [];
  const numbers = pair.flatMap(one => one.terms.slice(0, TERMS.length)), low = Math.min(0, ...numbers), high = Math.max(0.01, ...numbers);
  const title = document.createElement("p");
  title.textContent = pair[1] ? `What it costs, seconds: above ${pair[0].value.toFixed(1)}, taken; below ${pair[1].value.toFixed(1)}, the best of the others` : "What it costs, seconds";
  $("terms").replaceChildren(...!pair.length ? [] : [title, ...TERMS.flatMap((name, k) => {
    const label = document.createElement("span"), box = document.createElement("div"), zero = document.createElement("b");
    const share = part => `${100 * part / (high - low)}%`;
    label.textContent = name;
    for (const {terms} of pair) {
      const bar = document.createElement("i"), from = Math.min(0, terms[k]);
      bar.style.left = share(from - low); bar.style.width = share(Math.abs(terms[k]));
      box.append(bar);
    }
    zero.style.left = share(-low);
    box.append(zero);
    return [label, box];
  })]);
}

function modes() {
  const group = $("modes");
  if (!group.children.length) group.append(...state.modes.map(({name, title}) => {
    const button = document.createElement("button");
    button.dataset.mode = name;
    button.textContent = title;
    button.onclick = () => say({do: "mode", mode: name});
    return button;
  }));
  state.modes.forEach(({name, says, lack}, i) => {
    const button = group.children[i];
    button.setAttribute("aria-pressed", name === state.mode);
    button.disabled = lack !== "";
    button.title = lack || says;
  });
}

const nextMode = () => {
  const open = state.modes.filter(one => one.lack === "").map(one => one.name);
  return open[(open.indexOf(state.mode) + 1) % open.length];
};
const ALONE = "takes mode Matching: the paper's modes have one fish, which is sent to goals or wanders";

function people() {
  const count = state.fish.length, alone = state.most === 1;
  for (const option of $("count").options) option.disabled = Number(option.value) > state.most;
  $("count").title = alone ? "several fish: " + ALONE : "";
  $("path").disabled = alone;
  $("path").title = alone ? ALONE : "draw in the tank where to swim; a path that ends where it began repeats";
  if (document.activeElement !== $("count")) $("count").value = String(count);
  const choose = $("who");
  if (choose.options.length !== count + 1) {
    who = choose.options.length ? Math.min(who, count - 1) : state.explained;
    choose.replaceChildren(...state.fish.map((_, i) => new Option(`fish ${i + 1}`, i)), new Option("all fish", -1));
    $("fish").replaceChildren(...state.fish.map((_, i) => {
      const item = document.createElement("li"), button = document.createElement("button");
      button.append(document.createElement("b"), document.createElement("span"));
      button.onclick = () => choosing(i);
      item.append(button);
      return item;
    }));
    choose.value = String(who);
  }
  [...$("fish").querySelectorAll("button")].forEach((button, i) => {
    const fish = state.fish[i];
    button.setAttribute("aria-pressed", i === state.explained);
    const [name, what] = button.children;
    const goal = !fish ? "" : fish.rule !== null ? (fish.rule < 0 ? "swims in a group" : `follows fish ${fish.rule + 1}`) : fish.path ? (fish.path.begun ? "swims its path" : "is on its way to its path")
      : fish.goal ? (fish.goal[2] ? "has reached its goal, wanders" : "is on its way")
      : fish.done ? "has finished its path, wanders" : "wanders";
    const text = fish ? `${goal}; ${[...new Set([mode(fish.mode).title.toLowerCase(), fish.state])].join(", ")}, ${fish.speed.toFixed(1)} lengths/s` : "not there yet";
    if (name.textContent !== `fish ${i + 1}`) name.textContent = `fish ${i + 1}`;
    if (what.textContent !== text) what.textContent = text;
  });
}

function company() {
  const lead = $("lead"), count = state.fish.length;
  if (lead.options.length !== count + 1)
    lead.replaceChildren(new Option("Follow …", ""), ...state.fish.map((_, i) => new Option(`Follow fish ${i + 1}`, i)));
  $("shoal").disabled = lead.disabled = count < 2;
  $("shoal").disabled ||= !state.weights;
  lead.title = state.most === 1 ? ALONE : "";
  $("company").hidden = !state.weights;
  set("refused", state.refused);
  if (!state.weights) return;
  for (const input of document.querySelectorAll("[data-weight]")) {
    const weight = state.weights[input.dataset.weight];
    if (performance.now() > weighed) input.value = weight;
    input.disabled = state.widths[input.dataset.weight] === 0;
    input.title = input.disabled ? "there is no such zone: its radius is not larger than that of the zone within (calibrate.…)" : "";
    set("w" + input.dataset.weight, weight.toFixed(2));
  }
}

function because() {
  const now = state.decision, key = JSON.stringify([state.explained, now && now.tick, state.fish.length]);
  if (key === shown) return;
  shown = key;
  if (!now) { set("why", "This tick is not in the history."); $("candidates").replaceChildren(); costBars([]); return; }
  const taken = now.candidates.find(candidate => candidate.taken), fits = now.candidates.some(candidate => candidate.fails === "");
  const verdict = taken
    ? taken.fails === "" ? "Taken: the cheapest candidate that fails no test, or one about as cheap."
      : "No candidate passes every test; the best that stays in the tank is taken."
    : now.mode !== "matching" ? ""
    : now.candidates.length === 0 ? "No candidate is weighed here."
      : fits ? "No candidate gains enough." : "No candidate passes every test.";
  const ago = (now.tick - now.planned) / state.rate;
  const plan = now.mode === "matching" && ago > 0 ? `It follows a plan made ${ago.toFixed(1)} s before. ` : "";
  set("why", `${(now.tick / state.rate).toFixed(1)} s, fish ${state.explained + 1}: ${now.why}. ${plan}${verdict}`.trim());
  costBars(now.candidates);
  const number = (value, digits = 2) => value === null ? "–" : value.toFixed(digits);
  $("candidates").replaceChildren(...now.candidates.map(candidate => {
    const row = document.createElement("tr");
    row.className = candidate.taken ? "taken" : candidate.fails ? "fails" : "fits";
    const cells = [candidate.taken ? "taken" : candidate.fails ? FAILS[candidate.fails] : "possible", number(candidate.value),
      ...candidate.terms.map(term => number(term)), candidate.seam === 0 ? "on" : number(candidate.seam), candidate.row];
    row.append(...cells.map(cell => { const td = document.createElement("td"); td.textContent = cell; return td; }));
    return row;
  }));
  if (now.more) {
    const row = $("candidates").insertRow(), cell = row.insertCell();
    cell.colSpan = 12; cell.textContent = `and ${now.more} more`;
  }
}

function announce() {
  state.fish.forEach((fish, i) => {
    const done = Boolean(fish && fish.done);
    if (done && !told[i] && !state.past) $("told").textContent = `Fish ${i + 1} has ${fish.goal ? "reached its goal" : "finished its path"}.`;
    if (!state.past) told[i] = done;
  });
}

function choosing(number) {
  if (!state || number >= state.fish.length) return;
  who = number;
  $("who").value = String(number);
  if (number >= 0) say({do: "explain", fish: number});
}

// --- pointer: click and drag, or draw a path

const within = (value, most) => Math.min(Math.max(value, 0), most);

// A place of the screen, px of the device from the tank's corner.
function onCanvas(event) {
  const box = tank.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width * ways.width, (event.clientY - box.top) / box.height * ways.height];
}

// The place of the tank, px, that is seen there.
function place(event) {
  const [sx, sy] = onCanvas(event), {scale, left, top} = drawer.view;
  return [within((sx - left) / scale - 0.5, hello.width), within((sy - top) / scale - 0.5, hello.height)];
}

function send(x, y, again) {
  say({do: "goal", fish: who < 0 ? null : who, x: Math.round(x * 10) / 10, y: Math.round(y * 10) / 10, drag: again});
  $("hint").hidden = true;
  if (!again && !matchMedia("(prefers-reduced-motion: reduce)").matches) ripples.push({x, y, at: performance.now()});
}

const draws = () => !$("path").disabled && $("path").getAttribute("aria-pressed") === "true";

function follow(points) {
  const every = Math.ceil(points.length / MOST_PLACES);
  const places = points.filter((_, i) => i % every === 0 || i === points.length - 1).slice(-MOST_PLACES);
  say({do: "path", fish: who < 0 ? null : who, places});
  $("hint").hidden = true;
}

tank.addEventListener("pointerdown", event => {
  if (!state || !drawer || event.button || event.target.closest("button")) return;
  tank.setPointerCapture(event.pointerId);
  drag = event.pointerId;
  if (draws()) { stroke = [place(event).map(Math.round)]; dirty = true; }
  else send(...place(event), false);
});
tank.addEventListener("pointermove", event => {
  if (drag !== event.pointerId) return;
  if (stroke) {
    const [x, y] = place(event).map(Math.round), [a, b] = stroke[stroke.length - 1];
    if (Math.hypot(x - a, y - b) >= 2) { stroke.push([x, y]); dirty = true; }
    return;
  }
  if (!pending) requestAnimationFrame(() => { if (pending) send(...pending, true); pending = null; });
  pending = place(event);
});
for (const kind of ["pointerup", "pointercancel"]) tank.addEventListener(kind, event => {
  if (drag !== event.pointerId) return;
  if (pending) { send(...pending, true); pending = null; }
  if (stroke && kind === "pointerup") follow(stroke);
  drag = stroke = null;
});

tank.addEventListener("wheel", event => {
  if (!drawer || event.ctrlKey) return;  // the browser's own zoom
  event.preventDefault();
  zoomBy(Math.exp(-0.0015 * event.deltaY * (event.deltaMode ? 30 : 1)), ...onCanvas(event));
}, {passive: false});

// --- buttons

$("nearer").onclick = () => zoomBy(1.5);
$("farther").onclick = () => zoomBy(1 / 1.5);
$("follow").onclick = () => setFollow(!follows);
const pause = () => state && say({do: "pause", on: state.runs});
const step = way => {
  if (!state) return;
  if (way < 0) say({do: "look", tick: Math.max(state.oldest, state.tick - 1)});
  else if (state.past && state.tick < state.now) say({do: "look", tick: state.tick + 1});
  else say({do: "step"});
};
const now = () => say({do: "look", tick: null});
$("pause").onclick = pause;
$("step").onclick = () => step(1);
$("back").onclick = () => step(-1);
const from = () => state && state.past && say({do: "branch", tick: state.tick});
$("live").onclick = now;
$("from").onclick = from;
$("path").onclick = () => $("path").setAttribute("aria-pressed", !draws());
$("drop").onclick = () => say({do: "drop", fish: who < 0 ? null : who});
$("shoal").onclick = () => say({do: "rule", fish: who < 0 ? null : who, leader: null});
$("lead").onchange = event => {
  if (event.target.value !== "") say({do: "rule", fish: who < 0 ? null : who, leader: Number(event.target.value)});
  event.target.value = "";
};
for (const input of document.querySelectorAll("[data-weight]")) input.oninput = () => {
  weighed = performance.now() + 400;
  const [repulsion, alignment, attraction] = [...document.querySelectorAll("[data-weight]")].map(one => Number(one.value));
  say({do: "weights", repulsion, alignment, attraction});
};
$("speed").onchange = event => say({do: "speed", times: Number(event.target.value)});
$("who").onchange = event => choosing(Number(event.target.value));
$("draw").onchange = () => { dirty = true; };
for (let i = 1; i <= 8; i++) $("count").append(new Option(String(i), i));
$("count").onchange = event => say({do: "count", fish: Number(event.target.value)});
$("scrub").oninput = event => {
  held = performance.now() + 400;  // older frames, still on their way, do not take it back
  const tick = Number(event.target.value);
  say({do: "look", tick: tick < Number(event.target.max) ? tick : null});  // its end is now
};
addEventListener("resize", () => hello && resize());
document.addEventListener("visibilitychange", () => refresh.rest());

// --- keys

const MOVES = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]};
function nudge([dx, dy], little) {
  const fish = state.fish[Math.max(who, 0)];
  if (!fish) return;
  const far = Math.max(hello.width, hello.height) * (little ? 0.01 : 0.05);
  const [x, y] = fish.goal && !fish.goal[2] ? fish.goal : [fish.x, fish.y];
  send(within(x + dx * far, hello.width), within(y + dy * far, hello.height), false);
}
addEventListener("keydown", event => {
  if (!state || event.ctrlKey || event.metaKey || event.altKey) return;
  const at = event.target.tagName, key = event.key;
  if (at === "SELECT" || (key === " " && (["BUTTON", "SUMMARY"].includes(at) || event.target.type === "checkbox"))) return;
  if (MOVES[key] && at === "INPUT") return;
  const speeds = [...$("speed").options].map(option => Number(option.value));
  const faster = by => {
    const i = Math.max(0, speeds.indexOf(state.speed)) + by;
    if (speeds[i]) say({do: "speed", times: speeds[i]});
  };
  if (MOVES[key]) {
    if (event.target.closest(".wide")) return;
    nudge(MOVES[key], event.shiftKey);
  } else if (key === " ") pause();
  else if (key === ",") step(-1);
  else if (key === ".") step(1);
  else if (key === "l" || key === "L") now();
  else if (key === "b" || key === "B") from();
  else if (key === "+" || key === "=") faster(1);
  else if (key === "-") faster(-1);
  else if (key === "m" || key === "M") say({do: "mode", mode: nextMode()});
  else if (key === "z" || key === "Z") zoomBy(event.shiftKey ? 1 / 1.5 : 1.5);
  else if (key === "f" || key === "F") $("follow").click();
  else if (key === "c" || key === "C") $("shoal").click();
  else if (key === "p" || key === "P") $("path").click();
  else if (key === "Escape") { stroke = null; $("drop").click(); }
  else if (/^[0-8]$/.test(key)) choosing(Number(key) - 1);
  else return;
  event.preventDefault();
});

requestAnimationFrame(frame);
