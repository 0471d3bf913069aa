// The strip of picture along an animal's backbone: finloop/puppet/strip.py and lay.py for the page.
// A place of the strip is (i, t): i counts cross-sections from head to tail, t [px] lies beside the
// backbone. It is seen at B(i) + o N(i); o is t, squeezed on the inner side of a bend.

const BEYOND = 10;      // steps of a strip, straight, beyond either end of its backbone
const LEAST = 1e-6;     // px, the length of a cross-section that shows nothing
const HIDDEN = 1e9;     // px, a limit that is none
const STRIDE = 2, RIM = 1.5;  // px between the places where alpha is looked for; of a soft edge

// What the numbers of a fish's state (DRAWN) mean; the posture comes last.
const STATE = {x: 0, y: 1, heading: 2, size: 3, picture: 4, partner: 5, weight: 6, mirrored: 7,
  partnerMirrored: 8, look: 9, alpha: 10, posture: 11};

// Cross-sections of a posture of d numbers.
function sectionsOf(d) { return d / 2 + 2 * BEYOND; }

// An empty strip of m cross-sections: points, normals (to the left) and limits (left, right), px.
// It shows the sections `first` … `last`.
function emptyStrip(m) {
  return {m, points: new Float64Array(2 * m), normals: new Float64Array(2 * m),
    limits: new Float64Array(2 * m), first: 0, last: m - 1};
}

// Lay a strip along a backbone: line = [x, y, heading_rad, size_px], posture from `from` on.
function layStrip(strip, line, posture, from) {
  const {m, points, normals} = strip, n = m - 1 - 2 * BEYOND;
  const [x0, y0, heading, size] = line, bend = from + 2, step = from + 2 + n;
  const ahead = posture[from] * size, left = posture[from + 1] * size;
  const c = Math.cos(heading), s = Math.sin(heading);
  const x = x0 + c * ahead - s * left, y = y0 - s * ahead - c * left;
  const cos = Math.cos(heading + posture[bend]), sin = Math.sin(heading + posture[bend]);
  for (let i = 0; i <= BEYOND; i++) {
    const away = (BEYOND - i) * posture[step] * size;
    points[2 * i] = x + away * cos; points[2 * i + 1] = y - away * sin;
    normals[2 * i] = -sin; normals[2 * i + 1] = -cos;
  }
  for (let i = BEYOND + 1; i < m; i++) {
    const before = Math.min(i - BEYOND - 1, n - 1), after = Math.min(i - BEYOND, n - 1);
    const angle = heading + posture[bend + before], length = posture[step + before] * size;
    points[2 * i] = points[2 * i - 2] - length * Math.cos(angle);
    points[2 * i + 1] = points[2 * i - 1] + length * Math.sin(angle);
    const middle = angle + (posture[bend + after] - posture[bend + before]) / 2;
    normals[2 * i] = -Math.sin(middle); normals[2 * i + 1] = -Math.cos(middle);
  }
  limit(strip);
}

// The radii, left and right, of the largest circles that touch the backbone at one point only.
function limit(strip) {
  const {m, points, normals, limits} = strip, head = BEYOND, tail = m - 1 - BEYOND;
  let first = head, last = tail;
  while (first > 0 && isFree(strip, first - 1, head)) first--;
  while (last < m - 1 && isFree(strip, last + 1, tail)) last++;
  strip.first = first; strip.last = last;
  limits.fill(LEAST);
  for (let i = first; i <= last; i++) {
    let left = 1 / HIDDEN, right = 1 / HIDDEN;  // 1 / radius
    const x = points[2 * i], y = points[2 * i + 1], nx = normals[2 * i], ny = normals[2 * i + 1];
    for (let j = first; j <= last; j++) {
      const dx = points[2 * j] - x, dy = points[2 * j + 1] - y;
      const curvature = 2 * (dx * nx + dy * ny) / (dx * dx + dy * dy + LEAST * LEAST);
      if (curvature > left) left = curvature;
      if (-curvature > right) right = -curvature;
    }
    limits[2 * i] = 1 / left; limits[2 * i + 1] = 1 / right;
  }
}

// Whether point i, beyond an end of the backbone, is nearer to that end than to the rest.
function isFree({m, points}, i, end) {
  const square = j => (points[2 * j] - points[2 * i]) ** 2 + (points[2 * j + 1] - points[2 * i + 1]) ** 2;
  const own = 0.99 * square(end);
  for (let j = BEYOND; j < m - BEYOND; j++) if (square(j) < own) return false;
  return true;
}

// The place t that is seen so far from the backbone, o < limit.
function unsqueezed(o, limit) {
  const free = limit / 2;
  return o <= free ? o : free + 2 * free * (1 - Math.sqrt(1 - (o - free) / free));
}

// How far, px of the strip, the animal reaches on the left and right of each of its m − 1 steps.
// pixels: (height, width, channels), alpha last.
function reachOf(strip, pixels, width, height, channels) {
  const {m, points, normals, limits} = strip, rays = new Float64Array(2 * m);
  for (let i = 0; i < 2 * m; i++) {
    const at = i & ~1, sign = i & 1 ? -1 : 1, x = points[at], y = points[at + 1];
    const nx = sign * normals[at], ny = sign * normals[at + 1];
    let o = Math.min(limits[i], height + width);
    if (Math.abs(nx) > 1 / 1024) o = Math.min(o, Math.max((width - 1 - x) / nx, -x / nx));
    if (Math.abs(ny) > 1 / 1024) o = Math.min(o, Math.max((height - 1 - y) / ny, -y / ny));
    for (; o > 0; o -= STRIDE) {
      const u = Math.trunc(x + o * nx + 0.5), v = Math.trunc(y + o * ny + 0.5);
      if (u >= 0 && u < width && v >= 0 && v < height && pixels[(v * width + u + 1) * channels - 1]) break;
    }
    o = Math.max(o, 0) + STRIDE + RIM;
    rays[i] = o < limits[i] ? unsqueezed(o, limits[i]) : 2 * limits[i];
  }
  const reach = rays.slice(0, 2 * m - 2);  // and as far as those beside it: skin goes on between them
  for (let i = 0; i < 2 * m - 2; i++) {
    for (let k = Math.max(i - 2, i & 1); k <= Math.min(i + 4, 2 * m - 1); k += 2) reach[i] = Math.max(reach[i], rays[k]);
  }
  for (let i = 0; i < m - 1; i++) {
    if (isEmpty(strip, i, reach, pixels, width, height, channels)) reach[2 * i] = reach[2 * i + 1] = 0;
  }
  return reach;
}

// Whether all that the cubic filter reads for a step of a strip is transparent.
function isEmpty({points, normals}, i, reach, pixels, width, height, channels) {
  const low = [0, 0], high = [0, 0];
  for (let axis = 0; axis < 2; axis++) {
    const places = [];
    for (let k = i; k < i + 2; k++) for (let side = 0; side < 2; side++) {
      places.push(points[2 * k + axis] + (1 - 2 * side) * reach[2 * i + side] * normals[2 * k + axis]);
    }
    low[axis] = Math.max(Math.floor(Math.min(...places)) - 3, 0);
    high[axis] = Math.min(Math.ceil(Math.max(...places)) + 3, axis ? height - 1 : width - 1);
  }
  for (let v = low[1]; v <= high[1]; v++) for (let u = low[0]; u <= high[0]; u++) {
    if (pixels[(v * width + u + 1) * channels - 1]) return false;
  }
  return true;
}
