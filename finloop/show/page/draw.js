// The drawing: the screen is a function of the states of the fish (DRAWN), their looks, the pictures
// and the display. A small canvas, `glass`, lies over the still floor, just where fish are: in a
// browser without a graphics card it costs most to put a large canvas on the screen.

const PAD = 3;        // transparent px around a picture: what the cubic filter reads beyond it
const TEXELS = 6;     // of a cross-section: `shaders.SWIM`
const OVERLAP = 0.1;  // px of the screen by which the meshes of two steps overlap
const FRONT = 0.1;    // of the body: over it the skin changes to another picture's (`puppet.drawing`)
const SEAM = 1e-3;    // px by which the steps themselves do: rounding leaves no hole between them
const STEP = 256;     // px by which the glass grows
const MARGIN = 2;     // px around the mesh of a fish
const AS = {fish: 0, silhouette: 1, dot: 2};

class Drawer {
  // glass: the canvas of the fish; floor: the canvas beneath. spec: width, height, channels, posture,
  // slots, slot_width, slot_height, looks, fish, as in `hello`; tank: the empty one.
  constructor(glass, floor, spec, tank) {
    const gl = glass.getContext("webgl2", {
      alpha: true, premultipliedAlpha: true, antialias: false, depth: true, stencil: false,
      powerPreference: "high-performance",
    });
    if (!gl) throw new Error("this browser has no WebGL 2");
    Object.assign(this, {gl, glass, floor, spec});
    this.grey = spec.channels === 1;
    this.sections = sectionsOf(spec.posture);
    this.pictures = new Map(); this.atSlot = new Map();
    this.here = emptyStrip(this.sections);
    this.box = null;
    this.lost = this.warm = false;
    const most = Math.max(1, spec.fish);
    this.row = 4 * TEXELS;
    this.perFish = this.row * (this.sections + 1);
    this.strips = new Float32Array(this.perFish * most);
    this.rects = [];
    this._programs(); this._buffers(most); this._textures(tank);
  }

  _programs() {
    const grey = {GREY: Number(this.grey), PAD, FRONT, BEYOND, SEAM, OVERLAP, STEPS: this.sections - 1};
    this.swims = [0, 1].map(WARPED => program(this.gl, SWIM, SKIN, {...grey, WARPED}));
    this.ground = program(this.gl, COVER, FLOOR, grey);
    this.last = program(this.gl, COVER, TABLE);
  }

  // Two triangles a step.
  _buffers(most) {
    const {gl, sections} = this, steps = most * (sections - 1), corners = new Uint32Array(6 * steps);
    for (let i = 0; i < steps; i++) corners.set([0, 1, 2, 2, 1, 3].map(corner => 4 * i + corner), 6 * i);
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
  }

  _texture(unit, target) {
    const {gl} = this, made = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit); gl.bindTexture(target, made);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
    return made;
  }

  // Units: 0 pictures, 1 floor, 2 empty tank, 3 scene, 4 table, 5 strips.
  _textures(tank) {
    const {gl, spec, grey} = this;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1); gl.pixelStorei(gl.PACK_ALIGNMENT, 1);
    const layers = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    if (spec.slots > layers) throw new Error(`this browser holds ${layers} pictures, not ${spec.slots}`);
    this._texture(0, gl.TEXTURE_2D_ARRAY);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8,
      spec.slot_width + 2 * PAD, spec.slot_height + 2 * PAD, spec.slots);
    this._texture(2, gl.TEXTURE_2D);
    gl.texImage2D(gl.TEXTURE_2D, 0, grey ? gl.R8 : gl.RGB8, spec.width, spec.height, 0,
      grey ? gl.RED : gl.RGB, gl.UNSIGNED_BYTE, tank);
    this._texture(5, gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, TEXELS, this.strips.length / this.row);
  }

  // Take a picture of the film: pixels (height, width, channels + 1), premultiplied.
  picture(number, slot, width, height, line, posture, pixels) {
    const {gl, spec} = this, parts = spec.channels + 1;
    if (slot >= spec.slots || width > spec.slot_width || height > spec.slot_height || this.lost) return;
    const there = emptyStrip(this.sections);
    layStrip(there, line, posture, 0);
    gl.activeTexture(gl.TEXTURE0);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, slot, width + 2 * PAD, height + 2 * PAD, 1, gl.RGBA,
      gl.UNSIGNED_BYTE, texels(pixels, width, height, parts));
    const before = this.atSlot.get(slot);  // unless it has moved to another slot since
    if (this.pictures.get(before)?.slot === slot) this.pictures.delete(before);
    this.atSlot.set(slot, number);
    this.pictures.set(number, {
      slot, width, height, there, size: line[3], reach: reachOf(there, pixels, width, height, parts),
      ...summary(pixels, parts),
    });
    if (this.view && !this.warm) this._warm(number, line[3], posture);
  }

  // Draw a fish once and wipe it before it is seen: a shader is compiled when it is first used,
  // which takes many frames.
  _warm(number, size, posture) {
    this.warm = true;
    const {width, height} = this.spec;
    this.draw(Float32Array.from([width / 2, height / 2, 0, size, number, -1, 0, 0, 0, 0, 1, ...posture]), 1);
    this.draw(new Float32Array(0), 0);
  }

  // Draw for a screen of so many device px, as a display is calibrated.
  screen(width, height, ratio, display, mmPerPx) {
    if (this.lost) return;
    const {gl, spec, floor} = this;
    this.view = this.whole = viewOf(spec, width, height, display, mmPerPx);
    this.ratio = ratio;
    floor.style.transform = "none"; this.aimed = false;
    this.table = display && display.gamma
      ? Uint8Array.from(display.gamma.flatMap(([r, g, b]) => [r, g, b, 255]), Math.round) : null;
    this._target("floorFrame", 1, width, height, false);
    if (this.table) {
      this._target("sceneFrame", 3, width, height, true);
      this._texture(4, gl.TEXTURE_2D);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, this.table);
    }
    this._paintFloor(display);
    this.box = null; this.warm = false;
  }

  // Look at a part of the tank, over the floor as it is: `scale` px of the screen per px of the tank,
  // whose edge is at `left`, `top`. Between fish and floor the page may draw something of its own.
  aim(scale, left, top) {
    const {whole, ratio} = this, times = scale / whole.scale;
    this.view = {...whole, scale, left, top};
    this.aimed = true;
    this.floor.style.transform = `translate(${(left - whole.left * times) / ratio}px, ${(top - whole.top * times) / ratio}px) scale(${times})`;
  }

  // A frame buffer of the screen's size, its colours in a texture.
  _target(name, unit, width, height, deep) {
    const {gl} = this, old = this[name];
    if (old) { gl.deleteTexture(old.texture); gl.deleteFramebuffer(old.frame); gl.deleteRenderbuffer(old.depth); }
    const texture = this._texture(unit, gl.TEXTURE_2D), frame = gl.createFramebuffer();
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    let depth = null;
    if (deep) {
      depth = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    }
    this[name] = {texture, frame, depth};
  }

  _paintFloor(display) {
    const {gl, view, spec, floor} = this, {width, height} = view, {made, uniforms} = this.ground;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.floorFrame.frame);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.BLEND); gl.disable(gl.DEPTH_TEST); gl.disable(gl.SCISSOR_TEST);
    gl.useProgram(made);
    gl.uniform1i(uniforms.tank, 2);
    gl.uniform3f(uniforms.view, view.scale, view.left, view.top);
    gl.uniform2f(uniforms.size, width, height);
    gl.uniformMatrix3fv(uniforms.back, false, transposed(inverse(view.warp)));
    const tone = display && Array.isArray(display.background) ? display.background : null;
    gl.uniform4f(uniforms.tone, ...(tone ? tone.map(part => part / 255) : [0, 0, 0]), tone ? 1 : 0);
    gl.uniform1i(uniforms.grain, view.scale < 1 || view.warped ? 2 : 1);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const image = new ImageData(width, height), table = this.table;
    for (let row = 0; row < height; row++) {
      image.data.set(pixels.subarray(4 * width * (height - 1 - row), 4 * width * (height - row)), 4 * width * row);
    }
    if (table) for (let i = 0; i < image.data.length; i++) if (i % 4 < 3) image.data[i] = table[4 * image.data[i] + i % 4];
    floor.width = width; floor.height = height;
    floor.style.width = `${width / this.ratio}px`; floor.style.height = `${height / this.ratio}px`;
    floor.getContext("2d", {alpha: false}).putImageData(image, 0, 0);
    this.floorDigest = digestOf(new Uint32Array(image.data.buffer), 0);
    this.still = image;
  }

  // Draw `count` fish, F numbers each.
  draw(states, count) {
    if (this.lost) return;
    const {gl, view} = this, width = STATE.posture + this.spec.posture;
    this.rects.length = 0;
    let fish = 0;
    for (let i = 0; i < Math.min(count, this.spec.fish); i++) {
      if (this._lay(states, i * width, fish)) fish++;
    }
    const box = this.box = fish ? this._glass() : this._empty();
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.SCISSOR_TEST);
    gl.viewport(0, 0, box[2], box[3]);
    gl.clearColor(0, 0, 0, 0); gl.clearDepth(1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!fish) return;
    const up = view.height - box[1] - box[3];  // the box's lower edge, counted from below
    if (!this.table) {
      if (!this.aimed) this._under(null, box[0], up);
      this._fish(fish, box, box[0], up);
      return;
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.sceneFrame.frame);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this._under(this.sceneFrame.frame, 0, 0);
    gl.viewport(0, 0, view.width, view.height);
    this._fish(fish, [0, 0, view.width, view.height], 0, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this._toned(box, up);
  }

  // The strip of a fish, and its facts; whether there is anything to draw.
  _lay(states, from, fish) {
    const own = this.pictures.get(states[from + STATE.picture]);
    const alpha = states[from + STATE.alpha], look = this.spec.looks[states[from + STATE.look]];
    if (!own || !look || !(alpha > 0)) return false;
    let weight = states[from + STATE.weight];
    const other = weight > 0 ? this.pictures.get(states[from + STATE.partner]) || null : null;
    if (!other) weight = 0;
    const [x, y, heading] = states.subarray(from, from + 3), size = states[from + STATE.size] * look.size;
    const kind = AS[look.as];
    let radius = 0;
    if (kind === AS.dot) {
      const typical = this.spec.typical;  // else a dot would pulse with the beat of the tail
      const area = one => typical ? typical.area * size ** 2 : one.area * (size / one.size) ** 2;
      radius = Math.sqrt((area(own) + (other ? weight * (area(other) - area(own)) : 0)) / Math.PI);
      this._disc(radius, fish);
    } else {
      layStrip(this.here, [0, 0, heading, size], states, from + STATE.posture);
      const sides = [states[from + STATE.mirrored] > 0.5, states[from + STATE.partnerMirrored] > 0.5];
      this._skin(other ? [own, other] : [own], sides, size, fish);
    }
    const across = (one, side) => one ? one.size / size * (states[from + side] > 0.5 ? -1 : 1) : 1;
    const dark = this.spec.typical && this.spec.typical.dark;
    const tint = look.colour || dark || own.dark.map((part, c) => other ? part + weight * (other.dark[c] - part) : part);
    this.strips.set([
      own.slot, other ? other.slot : 0, weight, alpha,
      own.width, own.height, other ? other.width : 0, other ? other.height : 0,
      kind, look.contrast, 1 - (fish + 1) / (this.spec.fish + 1), radius,
      x, y, across(own, STATE.mirrored), across(other, STATE.partnerMirrored),
      ...tint.map(part => part / 255),
    ], (fish + 1) * this.perFish - this.row);
    return this._bound(fish, x, y);
  }

  // The strip of a fish in its posture, and the strips of its pictures; `puppet.lay.plan_strips`.
  _skin(sources, sides, size, fish) {
    const {here, sections, strips, row, perFish} = this;
    for (let i = 0; i < sections; i++) {
      const to = fish * perFish + i * row;
      section(strips, to, here, i);
      strips[to + 6] = strips[to + 7] = 0;
      for (let k = 0; k < sources.length; k++) {
        const {there, reach, size: filmed} = sources[k];
        section(strips, to + 8 * (k + 1), there, i);
        if (i === sections - 1 || i < there.first || i >= there.last || i < here.first || i >= here.last) continue;
        for (let side = 0; side < 2; side++) {
          const longest = Math.max(here.limits[2 * i + side], here.limits[2 * i + 2 + side]);
          const reached = reach[2 * i + (sides[k] ? 1 - side : side)] * size / filmed;
          strips[to + 6 + side] = Math.max(strips[to + 6 + side], Math.min(reached, longest));
        }
      }
    }
  }

  // A disc is drawn in the square of the first step.
  _disc(radius, fish) {
    const {strips, perFish, row, view} = this, half = radius + 1 / view.scale, from = fish * perFish;
    strips.fill(0, from, from + perFish);
    strips.set([-half, 0, 0, -1, 0, 0, half, half], from);
    strips.set([half, 0, 0, -1], from + row);
  }

  // The rectangle of the screen that a fish may cover; whether there is any.
  _bound(fish, x, y) {
    const {strips, sections, row, perFish, view} = this;
    let low = Infinity, high = -Infinity, top = Infinity, bottom = -Infinity;
    for (let i = 0; i < sections - 1; i++) {
      const from = fish * perFish + i * row, left = strips[from + 6], right = strips[from + 7];
      if (left + right === 0) continue;
      for (let corner = 0; corner < 4; corner++) {
        const at = corner < 2 ? from : from + row, beside = corner & 1 ? -right : left;
        const [u, v] = onScreen(view, x + strips[at] + beside * strips[at + 2], y + strips[at + 1] + beside * strips[at + 3]);
        if (u < low) low = u;
        if (u > high) high = u;
        if (v < top) top = v;
        if (v > bottom) bottom = v;
      }
    }
    const from = [Math.max(Math.floor(low) - MARGIN, 0), Math.max(Math.floor(top) - MARGIN, 0)];
    const to = [Math.min(Math.ceil(high) + MARGIN, view.width), Math.min(Math.ceil(bottom) + MARGIN, view.height)];
    if (!(to[0] > from[0] && to[1] > from[1])) return false;
    this.rects.push([...from, ...to]);
    return true;
  }

  // Put the glass where the fish are: left, top, width, height in px of the screen. It depends on
  // this frame alone, so that the same frame gives the same pixels.
  _glass() {
    const {view, ratio} = this, side = axis => {
      const size = axis ? view.height : view.width;
      if (ratio !== Math.round(ratio)) return [0, size];
      const low = Math.min(...this.rects.map(rect => rect[axis]));
      const high = Math.max(...this.rects.map(rect => rect[axis + 2]));
      const whole = Math.min(size, Math.ceil((high - low + ratio) / STEP) * STEP);
      return [Math.floor(Math.min(low, size - whole) / ratio) * ratio, whole];
    };
    const [left, width] = side(0), [top, height] = side(1);
    return this._place([left, top, width, height]);
  }

  _empty() { return this._place(this.box || [0, 0, 1, 1]); }

  _place(box) {
    const {glass, ratio} = this, [left, top, width, height] = box;
    if (glass.width !== width || glass.height !== height) {
      glass.width = width; glass.height = height;
      glass.style.width = `${width / ratio}px`; glass.style.height = `${height / ratio}px`;
    }
    glass.style.transform = `translate(${left / ratio}px, ${top / ratio}px)`;
    return box;
  }

  // Copy the floor under the fish. left, up: the frame buffer's corner on the screen.
  _under(frame, left, up) {
    const {gl, view} = this;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.floorFrame.frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, frame);
    for (const [x, top, right, down] of this.rects) {
      const low = view.height - down, high = view.height - top;
      gl.blitFramebuffer(x, low, right, high, x - left, low - up, right - left, high - up, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    }
  }

  // Draw the fish in a frame buffer: clip: left, top, width and height on the screen; left, up: its
  // corner, counted from the screen's left and lower edge.
  _fish(fish, clip, left, up) {
    const {gl, view, sections} = this, {made, uniforms} = this.swims[Number(view.warped)];
    gl.useProgram(made);
    gl.uniform1i(uniforms.skins, 0); gl.uniform1i(uniforms.ground, 1); gl.uniform1i(uniforms.strips, 5);
    gl.uniform2i(uniforms.corner, left, up);
    gl.uniform3f(uniforms.view, view.scale, view.left, view.top);
    gl.uniform4f(uniforms.clip, ...clip);
    gl.uniform1f(uniforms.high, view.height);
    gl.uniformMatrix3fv(uniforms.warp, false, transposed(view.warp));
    if (view.warped) gl.uniformMatrix3fv(uniforms.back, false, transposed(inverse(view.warp)));
    gl.activeTexture(gl.TEXTURE5);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, TEXELS, (sections + 1) * fish, gl.RGBA, gl.FLOAT, this.strips);
    gl.bindVertexArray(this.array);
    gl.enable(gl.DEPTH_TEST); gl.depthFunc(gl.LESS); gl.depthMask(true);
    gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.drawElements(gl.TRIANGLES, 6 * (sections - 1) * fish, gl.UNSIGNED_INT, 0);
  }

  // The scene through the table, on the glass.
  _toned([left, , width, height], up) {
    const {gl, view} = this, {made, uniforms} = this.last;
    gl.viewport(0, 0, width, height);
    gl.disable(gl.BLEND); gl.disable(gl.DEPTH_TEST); gl.enable(gl.SCISSOR_TEST);
    gl.useProgram(made);
    gl.uniform1i(uniforms.scene, 3); gl.uniform1i(uniforms.table, 4); gl.uniform2i(uniforms.corner, left, up);
    for (const [x, top, right, down] of this.rects) {
      gl.scissor(x - left, view.height - down - up, right - x, down - top);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.disable(gl.SCISSOR_TEST);
  }

  // The glass as just drawn, RGBA, the lowest row first. Call it in the same task as `draw`.
  pixels() {
    const {gl, box: [, , width, height]} = this, pixels = new Uint8Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return pixels;
  }

  // A number of 53 bits that stands for all pixels of the screen as just drawn; `square`: of the
  // square for a photodiode, 0 or 1.
  digest(square) {
    const fish = this.rects.length > 0, place = Uint32Array.from(fish ? [square, ...this.box] : [square]);
    const screen = digestOf(place, this.floorDigest);
    return fish ? digestOf(new Uint32Array(this.pixels().buffer), screen) : screen;
  }
}

// The texels of a picture with a transparent rim; one of grey and alpha holds the next px, too.
function texels(pixels, width, height, parts) {
  const wide = width + 2 * PAD, made = new Uint8Array(4 * wide * (height + 2 * PAD));
  for (let row = 0; row < height; row++) {
    const from = pixels.subarray(row * width * parts, (row + 1) * width * parts);
    const to = 4 * ((row + PAD) * wide + PAD);
    if (parts === 4) { made.set(from, to); continue; }
    for (let i = 0; i < width; i++) {
      const at = to + 4 * i;
      made[at] = made[at - 2] = from[2 * i]; made[at + 1] = made[at - 1] = from[2 * i + 1];
    }
  }
  return made;
}

// Write a cross-section: point and normal, then its limits.
function section(to, at, {points, normals, limits}, i) {
  to[at] = points[2 * i]; to[at + 1] = points[2 * i + 1];
  to[at + 2] = normals[2 * i]; to[at + 3] = normals[2 * i + 1];
  to[at + 4] = limits[2 * i]; to[at + 5] = limits[2 * i + 1];
}

// The area of a picture's animal, px², and its dark colour (R, G, B): the mean of the darkest
// twentieth of what is opaque, as a single pixel is noise.
function summary(pixels, parts) {
  let area = 0;
  const solid = [];
  for (let i = 0; i < pixels.length; i += parts) {
    const alpha = pixels[i + parts - 1];
    area += alpha / 255;
    if (alpha > 127) {
      const colour = [0, 1, 2].map(c => pixels[i + Math.min(c, parts - 2)] * 255 / alpha);
      solid.push([0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2], colour]);
    }
  }
  solid.sort((a, b) => a[0] - b[0]);
  const some = solid.slice(0, Math.max(1, Math.round(solid.length / 20)));
  const dark = [0, 1, 2].map(c => some.reduce((sum, [, colour]) => sum + Math.min(colour[c], 255), 0) / (some.length || 1));
  return {area, dark};
}

// A number of 53 bits for words of 32 bits (two hashes like FNV-1a, mixed as in MurmurHash3).
function digestOf(words, seed) {
  let low = (seed % 2 ** 32 ^ 0x811c9dc5) | 0, high = (Math.floor(seed / 2 ** 32) ^ 0x5bd1e995) | 0;
  for (let i = 0; i < words.length; i++) {
    low = Math.imul(low ^ words[i], 0x01000193); low ^= low >>> 15;
    high = Math.imul(high ^ words[i], 0x85ebca6b); high ^= high >>> 13;
  }
  return (high >>> 0) % 2 ** 21 * 2 ** 32 + (low >>> 0);
}
