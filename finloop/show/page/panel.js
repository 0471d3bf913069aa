// The calibration panel: the size of a px, the background, the place of the picture, levels, square.

const CARD_MM = [85.6, 53.98];  // ISO/IEC 7810 ID-1: bank cards
const CORNERS = ["top left", "top right", "bottom right", "bottom left"];

class Panel {
  // screen(): {width, height, ratio, refresh} of the window; draw(display): draw by it; save(display).
  constructor(screen, draw, save) {
    Object.assign(this, {screen, draw, save, display: null, drag: null, waits: 0});
    this.root = $("panel"); this.gamma = null;
    this.root.addEventListener("submit", event => event.preventDefault());
    for (const input of this.root.querySelectorAll("input, select, textarea")) {
      input.addEventListener("input", () => this._read());
    }
    $("mm").addEventListener("input", () => this._mm(Number($("mm").value)));
    $("mm-number").addEventListener("input", () => this._mm(Number($("mm-number").value)));
    $("corners-reset").onclick = () => { this.corners = null; this._handles(); this._read(); };
    $("levels-apply").onclick = () => this._levels();
    $("levels-file").onchange = async () => {
      const [file] = $("levels-file").files;
      if (file) { $("levels-text").value = await file.text(); this._levels(); }
    };
    $("patch").oninput = () => this._patch(Number($("patch").value));
    $("patch-off").onclick = () => this._patch(null);
    $("test").onclick = () => this.test();
    $("full").onclick = fullScreen;
    $("save").onclick = () => { this._read(); this.save(this.display); this.tell("Saved."); };
    $("close").onclick = () => this.open(false);
    this._drags();
  }

  get isOpen() { return !this.root.hidden; }
  get isTest() { return !$("grid").hidden; }

  open(on) {
    this.root.hidden = !on; $("handles").hidden = !on; $("card").hidden = !on;
    document.body.classList.toggle("calibrates", on);
    if (on) { this._handles(); this._card(); this.root.querySelector("input").focus(); } else { this._patch(null); this.test(false); }
  }

  tell(text, bad = false) { const said = $("panel-said"); said.textContent = text; said.classList.toggle("bad", bad); }

  // Show what a display is set to, or nothing yet.
  set(display, name, mmPerPx) {
    const one = display || {px_per_mm: null, background: "film", gamma: null, corners: null, square: null, scale: null};
    this.mmPerPx = mmPerPx;
    $("panel-name").textContent = name;
    this.corners = one.corners; this.gamma = one.gamma;
    this.mm = one.px_per_mm; this._showMm();
    $("tone").value = one.background === "film" ? "film" : "even";
    if (one.background !== "film") $("tone-colour").value = hex(one.background);
    $("levels").value = one.gamma ? "table" : "none";
    $("scale").value = one.scale || "";
    $("square-corner").value = one.square ? one.square.corner : "";
    if (one.square) $("square-size").value = one.square.size_px;
    this._choose();
    this.display = this._made();
    this._handles();
  }

  _made() {
    const {width, height, ratio, refresh} = this.screen(), corner = $("square-corner").value;
    return {
      version: 1, px_per_mm: this.mm, width_px: width, height_px: height, ratio,
      background: $("tone").value === "film" ? "film" : rgb($("tone-colour").value),
      gamma: this.gamma, corners: this.corners,
      square: corner ? {corner, size_px: Math.max(1, Math.round(Number($("square-size").value) || 1))} : null,
      scale: Number($("scale").value) > 0 ? Number($("scale").value) : null, refresh_hz: refresh,
    };
  }

  _read() {
    if ($("levels").value === "none") this.gamma = null;
    this._choose();
    this.display = this._made();
    cancelAnimationFrame(this.waits);
    this.waits = requestAnimationFrame(() => { this.draw(this.display); this._grid(); });
  }

  _choose() {
    $("tone-colour").hidden = $("tone").value === "film";
    for (const part of this.root.querySelectorAll("[data-levels]")) {
      part.hidden = !part.dataset.levels.split(" ").includes($("levels").value);
    }
    $("square-size").disabled = !$("square-corner").value;
    const {width, height, refresh} = this.screen();
    const mm = this.mm ? `, ${(width / this.mm).toFixed(0)} × ${(height / this.mm).toFixed(0)} mm` : "";
    $("panel-screen").textContent = `${width} × ${height} px${mm}, ${refresh.toFixed(2)} Hz`;
    $("scale").placeholder = this.mm && this.mmPerPx ? `${(this.mm * this.mmPerPx).toFixed(3)} (real size)` : "fit the screen";
  }

  // --- the size of a px

  _mm(value) { if (value > 0) { this.mm = value; this._showMm(); this._read(); } }

  _showMm() {
    const shown = this.mm || 96 / 25.4 * this.screen().ratio;
    $("mm").value = shown; $("mm-number").value = this.mm ? shown.toFixed(3) : "";
    this._card();
  }

  _card() {
    const {ratio} = this.screen(), card = $("card"), perMm = Number($("mm").value) / ratio;
    card.style.width = `${CARD_MM[0] * perMm}px`; card.style.height = `${CARD_MM[1] * perMm}px`;
  }

  // --- levels

  _levels() {
    try {
      const kind = $("levels").value, text = $("levels-text").value;
      if (kind === "exponents") this.gamma = tableOfExponents(["r", "g", "b"].map(c => this._exponent(c)));
      if (kind === "luminances") this.gamma = tableOfLuminances(numbersOf(text));
      if (kind === "table") this.gamma = tableOfText(text);
      this.tell("These levels are applied now; they are kept by Save.");
      this._read();
    } catch (error) { this.tell(error.message, true); }
  }

  _exponent(channel) {
    const value = Number($(`exponent-${channel}`).value);
    if (!(value >= 0.2 && value <= 5)) throw new Error("exponents are 0.2 to 5");
    return value;
  }

  // A grey all over, as it is sent, to be measured.
  _patch(level) {
    const patch = $("even");
    patch.hidden = level === null;
    $("patch-level").textContent = level === null ? "off" : level;
    if (level !== null) patch.style.background = `rgb(${level} ${level} ${level})`;
  }

  // --- where the corners go

  _handles() {
    const {width, height, ratio} = this.screen(), places = this.corners || [[0, 0], [1, 0], [1, 1], [0, 1]];
    [...$("handles").children].forEach((handle, i) => {
      const inside = (share, size) => Math.min(Math.max(share * size, 14), size - 14);
      handle.style.left = `${inside(places[i][0], width / ratio)}px`;
      handle.style.top = `${inside(places[i][1], height / ratio)}px`;
    });
  }

  _move(i, x, y) {
    const places = (this.corners || [[0, 0], [1, 0], [1, 1], [0, 1]]).map(place => place.slice());
    places[i] = [x, y].map(share => Math.round(Math.min(Math.max(share, -1), 2) * 1e5) / 1e5);
    if (!isConvex(places)) return;
    this.corners = places;
    this._handles(); this._read();
  }

  _drags() {
    [...$("handles").children].forEach((handle, i) => {
      handle.onpointerdown = event => { handle.setPointerCapture(event.pointerId); this.drag = i; };
      handle.onpointerup = () => { this.drag = null; };
      handle.onpointermove = event => {
        if (this.drag === i) this._move(i, event.clientX / innerWidth, event.clientY / innerHeight);
      };
      handle.onkeydown = event => {
        const way = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key];
        if (!way) return;
        event.preventDefault(); event.stopPropagation();
        const [x, y] = (this.corners || [[0, 0], [1, 0], [1, 1], [0, 1]])[i], far = event.shiftKey ? 10 : 1;
        const {width, height} = this.screen();
        this._move(i, x + way[0] * far / width, y + way[1] * far / height);
      };
    });
  }

  // --- the test picture

  test(on = !this.isTest) {
    $("grid").hidden = !on; $("card").hidden = on || !this.isOpen;
    $("test").setAttribute("aria-pressed", on);
    this._grid();
  }

  _grid() {
    const canvas = $("grid");
    if (canvas.hidden) return;
    const {width, height, ratio} = this.screen();
    canvas.width = width; canvas.height = height;
    canvas.style.width = `${width / ratio}px`; canvas.style.height = `${height / ratio}px`;
    paintGrid(canvas.getContext("2d"), width, height, projection(this.corners, width, height), this.mm, ratio);
  }
}

// Lines and numbers every 100 px, or every 10 mm where a mm is known, as warped as the picture.
function paintGrid(pen, width, height, m, mm, ratio) {
  const on = (x, y) => {
    const w = m[6] * x + m[7] * y + m[8];
    return [(m[0] * x + m[1] * y + m[2]) / w, (m[3] * x + m[4] * y + m[5]) / w];
  };
  const line = (x0, y0, x1, y1) => { pen.beginPath(); pen.moveTo(...on(x0, y0)); pen.lineTo(...on(x1, y1)); pen.stroke(); };
  const step = mm ? 10 * mm : 100, unit = mm ? 10 : 100, name = mm ? "mm" : "px";
  pen.fillStyle = "#000c"; pen.fillRect(0, 0, width, height);
  pen.font = `${11 * ratio}px system-ui, sans-serif`; pen.textAlign = "center"; pen.textBaseline = "middle";
  const x0 = (width / 2) % step, y0 = (height / 2) % step;  // from the middle out
  for (const [from, size, across] of [[x0, width, true], [y0, height, false]]) {
    for (let at = from; at <= size + 0.5; at += step) {
      const count = Math.round((at - size / 2) / step);
      pen.strokeStyle = count === 0 ? "#ffbe28" : count % 5 ? "#3d4a50" : "#8fa3ad"; pen.lineWidth = ratio;
      if (across) line(at, 0, at, height); else line(0, at, width, at);
      if (count % (step < 60 * ratio ? 5 : 1)) continue;
      pen.fillStyle = "#e8eff2";
      const label = count === 0 ? (across ? name : "") : String(Math.abs(count) * unit);
      pen.fillText(label, ...on(across ? at : width / 2, across ? height / 2 : at));
    }
  }
  pen.strokeStyle = "#35c9a5"; pen.lineWidth = 3 * ratio;
  for (const [a, b, c, d] of [[0, 0, width, 0], [width, 0, width, height], [width, height, 0, height], [0, height, 0, 0]]) line(a, b, c, d);
  pen.strokeStyle = "#8fa3ad"; pen.lineWidth = ratio;
  pen.beginPath();  // a circle shows whether x and y are alike
  for (let i = 0; i <= 90; i++) {
    const angle = i / 45 * Math.PI, radius = Math.min(width, height) * 0.4;
    pen.lineTo(...on(width / 2 + radius * Math.cos(angle), height / 2 + radius * Math.sin(angle)));
  }
  pen.stroke();
}

// Whether four corners go round clockwise, with none bent inwards.
function isConvex(corners) {
  return corners.every(([bx, by], i) => {
    const [ax, ay] = corners[(i + 3) % 4], [cx, cy] = corners[(i + 1) % 4];
    return (bx - ax) * (cy - by) - (by - ay) * (cx - bx) > 1e-3;
  });
}

function hex(colour) { return "#" + colour.map(part => Math.round(part).toString(16).padStart(2, "0")).join(""); }
function rgb(text) { return [1, 3, 5].map(at => parseInt(text.slice(at, at + 2), 16)); }
