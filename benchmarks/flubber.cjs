// Reads pairs of outlines (JSON) and writes what flubber makes of each: corresponding points, as JSON.
// flubber moves every point straight from its place in the first outline to that in the second.
const { interpolate } = require("flubber");
const pairs = JSON.parse(require("fs").readFileSync(0, "utf8"));
const ends = pairs.map(([a, b, maxSegmentLength]) => {
  const shape = interpolate(a, b, { string: false, maxSegmentLength });
  return [shape(1e-9), shape(1 - 1e-9)];
});
process.stdout.write(JSON.stringify(ends));
