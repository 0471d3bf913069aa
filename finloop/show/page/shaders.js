// What runs on the graphics processor. Colours are 0 … 1, premultiplied by alpha.

const HEAD = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\nprecision highp sampler2DArray;\n";

// Keys' cubic filter, a = −1/2: weights of the pixels −1, 0, 1, 2 for a place t in [0, 1) after 0.
const KEYS = `
vec4 keys(float t) {
  return 0.5 * vec4(((2. - t) * t - 1.) * t, (3. * t - 5.) * t * t + 2., ((4. - 3. * t) * t + 1.) * t, (t - 1.) * t * t);
}
`;

// A triangle that covers all.
const COVER = `
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4. - 1., 0., 1.); }
`;

// The floor: the empty tank, or an even tone, once per screen px. view: px per px of the tank, and
// the left and upper edge of the tank. back: from px of the screen to where they are unwarped.
const FLOOR = KEYS + `
uniform sampler2D tank;
uniform vec3 view; uniform vec2 size; uniform mat3 back; uniform vec4 tone; uniform int grain;
out vec4 colour;
vec3 level(vec2 at) {
  ivec2 most = textureSize(tank, 0) - 1;
  vec2 uv = (at - view.yz) / view.x - 0.5, base = floor(uv);
  if (any(lessThan(uv, vec2(-0.5))) || any(greaterThan(uv, vec2(most) + 0.5))) return vec3(0.);
  vec4 across = keys(uv.x - base.x), down = keys(uv.y - base.y);
  vec3 sum = vec3(0.);
  for (int j = 0; j < 4; j++) for (int i = 0; i < 4; i++) {
    ivec2 place = clamp(ivec2(base) + ivec2(i - 1, j - 1), ivec2(0), most);
    vec4 texel = texelFetch(tank, place, 0);
    sum += across[i] * down[j] * (GREY == 1 ? texel.rrr : texel.rgb);
  }
  return clamp(sum, 0., 1.);
}
void main() {
  vec3 sum = vec3(0.);
  for (int j = 0; j < grain; j++) for (int i = 0; i < grain; i++) {
    vec2 at = floor(gl_FragCoord.xy) + (vec2(i, j) + 0.5) / float(grain);
    vec3 from = back * vec3(at.x, size.y - at.y, 1.);
    vec2 place = from.xy / from.z;
    if (from.z <= 0. || any(lessThan(place, vec2(0.))) || any(greaterThan(place, size))) continue;
    sum += tone.a > 0.5 ? tone.rgb : level(place);
  }
  colour = vec4(sum / float(grain * grain), 1.);
}
`;

// A corner of a step of a fish's strip, between the cross-sections `front` and `rear`. strips: a row
// per section; its texels: (point, normal) and (limits, reach of the step after it) on the screen,
// left and right, then (point, normal) and (limits) in the picture, and in the partner's. Places are
// px; on the screen, from the fish's middle. A fish's last row has its facts: slots, weight, alpha;
// sizes of the pictures; what it looks like, contrast, depth, radius; its middle, px of film per px
// of the tank in both pictures, < 0 where mirrored; its colour. clip: left, upper edge, width and
// height, px of the screen, of what is drawn on.
const SWIM = `
uniform highp sampler2D strips;
uniform vec3 view; uniform vec4 clip; uniform mat3 warp;
flat out vec4 front, rear, ends, front0, rear0, ends0, front1, rear1, ends1;
flat out vec4 slots, sizes, how, middle; flat out vec3 tint; flat out float number;
void main() {
  int step_ = gl_VertexID / 4, corner = gl_VertexID % 4, fish = step_ / STEPS;
  number = float(step_ % STEPS - BEYOND);
  int a = step_ + 2 * fish, b = a + 1, facts = (fish + 1) * (STEPS + 2) - 1;
  slots = texelFetch(strips, ivec2(0, facts), 0); sizes = texelFetch(strips, ivec2(1, facts), 0);
  how = texelFetch(strips, ivec2(2, facts), 0); middle = texelFetch(strips, ivec2(3, facts), 0);
  tint = texelFetch(strips, ivec2(4, facts), 0).rgb;
  front = texelFetch(strips, ivec2(0, a), 0); rear = texelFetch(strips, ivec2(0, b), 0);
  vec4 beside = texelFetch(strips, ivec2(1, a), 0);
  ends = vec4(beside.xy, texelFetch(strips, ivec2(1, b), 0).xy);
  front0 = texelFetch(strips, ivec2(2, a), 0); rear0 = texelFetch(strips, ivec2(2, b), 0);
  ends0 = vec4(texelFetch(strips, ivec2(3, a), 0).xy, texelFetch(strips, ivec2(3, b), 0).xy);
  front1 = texelFetch(strips, ivec2(4, a), 0); rear1 = texelFetch(strips, ivec2(4, b), 0);
  ends1 = vec4(texelFetch(strips, ivec2(5, a), 0).xy, texelFetch(strips, ivec2(5, b), 0).xy);
  vec4 section = corner < 2 ? front : rear;
  vec2 place = middle.xy + section.xy + ((corner & 1) == 0 ? beside.z : -beside.w) * section.zw;
  // Corners are rounded to parts of a px: steps overlap, so that no px is lost between them.
  place += (corner < 2 ? OVERLAP : -OVERLAP) / view.x * vec2(-section.w, section.z);
  vec3 on = warp * vec3(view.yz + (place + 0.5) * view.x, 1.);
  gl_Position = vec4((2. * (on.xy - clip.xy * on.z) / clip.zw - on.z) * vec2(1., -1.), (2. * how.z - 1.) * on.z, on.z);
}
`;

// A fish as filmed, its silhouette, or a disc, px by px as `puppet.lay` says. A fish has one depth:
// of two parts of it that meet, one is seen. Its contrast c makes of it: floor + c (fish over floor
// − floor). corner, size: of what is drawn on, from the screen's left and lower edge; of the screen.
const SKIN = KEYS + `
uniform sampler2DArray skins; uniform sampler2D ground;
uniform ivec2 corner; uniform vec3 view; uniform float high; uniform mat3 back;
flat in vec4 front, rear, ends, front0, rear0, ends0, front1, rear1, ends1;
flat in vec4 slots, sizes, how, middle; flat in vec3 tint; flat in float number;
out vec4 colour;
#if GREY
#define SUM vec2
SUM row(ivec3 at, vec4 across) {  // a texel holds its px and the next: grey, alpha, grey, alpha
  vec4 one = texelFetch(skins, at, 0), two = texelFetch(skins, at + ivec3(2, 0, 0), 0);
  return across.x * one.xy + across.y * one.zw + across.z * two.xy + across.w * two.zw;
}
#else
#define SUM vec4
SUM row(ivec3 at, vec4 across) {
  return across.x * texelFetch(skins, at, 0) + across.y * texelFetch(skins, at + ivec3(1, 0, 0), 0)
    + across.z * texelFetch(skins, at + ivec3(2, 0, 0), 0) + across.w * texelFetch(skins, at + ivec3(3, 0, 0), 0);
}
#endif
vec4 skin(vec2 at, vec2 size, float slot) {
  if (any(lessThan(at, vec2(-2.))) || any(greaterThanEqual(at, size + 1.))) return vec4(0.);
  vec2 base = floor(at), part = at - base;
  vec4 across = keys(part.x), down = keys(part.y);
  ivec3 from = ivec3(ivec2(base) + PAD - 1, int(slot));
  SUM sum = down.x * row(from, across) + down.y * row(from + ivec3(0, 1, 0), across)
    + down.z * row(from + ivec3(0, 2, 0), across) + down.w * row(from + ivec3(0, 3, 0), across);
#if GREY
  vec4 whole = sum.xxxy;
#else
  vec4 whole = sum;
#endif
  whole /= max(whole.a, 1.);  // where alpha overshoots, the colour goes with it
  whole.a = max(whole.a, 0.);
  return vec4(clamp(whole.rgb, 0., whole.a), whole.a);
}
// A place of the strip in a picture: beside the backbone, along it, and the share between sections.
vec4 lifted(vec3 at, float scale, vec4 from, vec4 to, vec4 ends_, vec2 size, float slot) {
  float t = at.x * scale, side = abs(t);
  vec2 both = mix(ends_.xy, ends_.zw, at.z);
  float limit = t >= 0. ? both.x : both.y, free = 0.5 * limit, far = (side - free) / free;
  if (far >= 2.) return vec4(0.);
  float o = sign(t) * (far <= 0. ? side : free + free * (far - 0.25 * far * far));
  vec4 section = mix(from, to, at.z);
  float along = at.y * abs(scale);
  return skin(section.xy + o * section.zw + along * vec2(section.w, -section.z), size, slot);
}
vec2 place() {
  vec2 on = vec2(gl_FragCoord.x + float(corner.x), high - gl_FragCoord.y - float(corner.y));
  if (WARPED == 1) { vec3 from = back * vec3(on, 1.); on = from.xy / from.z; }
  return (on - view.yz) / view.x - 0.5 - middle.xy;
}
vec4 fish() {
  vec2 at = place();
  float before = dot(at - front.xy, vec2(front.w, -front.z)), after = dot(rear.xy - at, vec2(rear.w, -rear.z));
  if (min(before, after) < -SEAM || before + after < 1e-9) return vec4(0.);
  float share = before / (before + after);
  vec4 section = mix(front, rear, share);
  vec2 away = at - section.xy, both = mix(ends.xy, ends.zw, share);
  float norm = 1. / dot(section.zw, section.zw), o = dot(away, section.zw) * norm;
  float limit = o >= 0. ? both.x : both.y, free = 0.5 * limit, far = (abs(o) - free) / free;
  if (far >= 1.) return vec4(0.);
  float t = far <= 0. ? o : sign(o) * (free + 2. * free * (1. - sqrt(1. - far)));
  vec3 strip = vec3(t, dot(away, vec2(section.w, -section.z)) * norm, share);
  vec4 seen = lifted(strip, middle.z, front0, rear0, ends0, sizes.xy, slots.x);
  if (slots.z <= 0.) return seen;
  // The partner's skin gives way from the tail on, its outline at once: no double image.
  vec4 old = lifted(strip, middle.w, front1, rear1, ends1, sizes.zw, slots.y);
  float left = clamp(((1. + FRONT) * slots.z - clamp((number + share) / float(STEPS - 2 * BEYOND), 0., 1.)) / FRONT, 0., 1.);
  vec4 mixed = mix(seen, old, left), outline = slots.z > 0.5 ? old : seen;
  float most = max(max(outline.a, mixed.a), 1e-6);
  return mixed * (outline.a / most) + outline * (1. - mixed.a / most);
}
void main() {
  vec4 seen = how.x > 1.5 ? vec4(clamp((how.w - length(place())) * view.x + 0.5, 0., 1.)) : fish();
  if (how.x > 0.5) seen.rgb = tint * seen.a;
  seen *= slots.w;
  if (how.y != 1.) {
    vec3 under = texelFetch(ground, ivec2(gl_FragCoord.xy) + corner, 0).rgb;
    float alpha = min(1., how.y * seen.a);
    seen = vec4(clamp(under + how.y * (seen.rgb - seen.a * under), 0., 1.) - (1. - alpha) * under, alpha);
  }
  if (seen.a <= 0.) discard;
  colour = seen;
#if WARPED
  gl_FragDepth = how.z;  // exactly the same everywhere
#endif
}
`;

// What is sent for a level: a table, applied last.
const TABLE = `
uniform sampler2D scene; uniform sampler2D table; uniform ivec2 corner;
out vec4 colour;
float sent(float level, int channel) { return texelFetch(table, ivec2(int(level * 255. + 0.5), 0), 0)[channel]; }
void main() {
  vec3 level = texelFetch(scene, ivec2(gl_FragCoord.xy) + corner, 0).rgb;
  colour = vec4(sent(level.r, 0), sent(level.g, 1), sent(level.b, 2), 1.);
}
`;

function program(gl, vertex, fragment, words = {}) {
  const made = gl.createProgram();
  const define = Object.entries(words).map(([name, value]) => `#define ${name} ${value}\n`).join("");
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, HEAD + define + text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(made, i).name.replace("[0]", "");
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return {made, uniforms};
}
