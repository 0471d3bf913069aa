// What is sent to a display for a wanted level: tables of 256 rows (R, G, B), 0 … 255.

function table(of) {
  return Array.from({length: 256}, (_, level) => [0, 1, 2].map(c => Math.round(100 * of[c](level)) / 100));
}

// Of a display whose channels shine as level ^ exponent.
function tableOfExponents(exponents) {
  return table(exponents.map(one => level => 255 * (level / 255) ** (1 / one)));
}

// From luminances measured at some levels: rows of level, luminance or level, R, G, B luminances.
// Between two of them the exponent of the display is taken to change evenly.
function tableOfLuminances(rows) {
  const sorted = rows.slice().sort((a, b) => a[0] - b[0]);
  if (sorted.length < 3 || sorted[0][0] !== 0 || sorted[sorted.length - 1][0] !== 255) {
    throw new Error("measure at 3 levels or more, 0 and 255 among them");
  }
  return table([1, 2, 3].map(c => channelOf(sorted.map(row => [row[0], row[Math.min(c, row.length - 1)]]))));
}

function channelOf(points) {
  const dark = points[0][1], bright = points[points.length - 1][1];
  if (!(bright > dark)) throw new Error("level 255 has to be brighter than level 0");
  const knots = points.filter(([level, shine]) => level > 0 && level < 255 && shine > dark && shine < bright)
    .map(([level, shine]) => [level, Math.log((shine - dark) / (bright - dark)) / Math.log(level / 255)]);
  if (!knots.length) throw new Error("no level between 0 and 255 is darker than 255 and brighter than 0");
  const exponent = level => {
    const after = knots.findIndex(knot => knot[0] >= level);
    if (after === 0) return knots[0][1];
    if (after < 0) return knots[knots.length - 1][1];
    const [[l, e], [m, f]] = [knots[after - 1], knots[after]];
    return e + (f - e) * (level - l) / (m - l);
  };
  const curve = [];
  for (let level = 0, most = 0; level < 256; level++) {
    most = Math.max(most, level ? (level / 255) ** exponent(level) : 0);
    curve.push(most);
  }
  return level => {
    const wanted = level / 255, after = Math.max(curve.findIndex(shine => shine >= wanted), 1);
    const [low, high] = [curve[after - 1], curve[after]];
    return high > low ? after - 1 + Math.min((wanted - low) / (high - low), 1) : after;
  };
}

// Rows of numbers from pasted text: a header and empty lines are left out.
function numbersOf(text) {
  const lines = text.split(/\r?\n/).map(line => line.trim()).filter(Boolean);
  const rows = lines.map(line => line.split(/[\s,;]+/).filter(Boolean).map(Number));
  if (rows.length && rows[0].some(Number.isNaN)) rows.shift();
  const wrong = rows.findIndex(row => row.some(Number.isNaN) || row.length !== rows[0].length);
  if (wrong >= 0) throw new Error(`row ${wrong + 1} has no ${rows[0].length} numbers`);
  return rows;
}

// A table that was made elsewhere: 256 rows of R, G, B, or of level, R, G, B.
function tableOfText(text) {
  const rows = numbersOf(text).map(row => row.slice(-3));
  if (rows.length !== 256 || rows[0].length !== 3) throw new Error(`${rows.length} rows, wanted 256 of R, G, B`);
  if (rows.flat().some(level => level < 0 || level > 255)) throw new Error("levels are 0 to 255");
  return rows;
}
