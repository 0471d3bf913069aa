// Where a px of the tank is on the screen: made larger, in the middle, then warped.

// The matrix (rows) of the projection that takes the screen's corners to `corners`, shares of it.
function projection(corners, width, height) {
  if (!corners) return [1, 0, 0, 0, 1, 0, 0, 0, 1];
  const [[x0, y0], [x1, y1], [x2, y2], [x3, y3]] = corners;  // Heckbert 1989: the square to a quad
  const sx = x0 - x1 + x2 - x3, sy = y0 - y1 + y2 - y3;
  const dx1 = x1 - x2, dy1 = y1 - y2, dx2 = x3 - x2, dy2 = y3 - y2, det = dx1 * dy2 - dx2 * dy1;
  const g = (sx * dy2 - dx2 * sy) / det, h = (dx1 * sy - sx * dy1) / det;
  return [
    x1 - x0 + g * x1, (x3 - x0 + h * x3) * width / height, x0 * width,
    (y1 - y0 + g * y1) * height / width, y3 - y0 + h * y3, y0 * height,
    g / width, h / height, 1,
  ];
}

function inverse(m) {
  const [a, b, c, d, e, f, g, h, i] = m;
  const A = e * i - f * h, B = f * g - d * i, C = d * h - e * g, det = a * A + b * B + c * C;
  return [A, c * h - b * i, b * f - c * e, B, a * i - c * g, c * d - a * f, C, b * g - a * h, a * e - b * d]
    .map(part => part / det);
}

function transposed(m) { return [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]]; }

// The view of a tank (width, height px) on a screen of screenWidth × screenHeight device px.
// scale: screen px per px of the tank; left, top: of the tank's edge, whole px; warp: matrix.
function viewOf(tank, screenWidth, screenHeight, display, mmPerPx) {
  const fits = Math.min(screenWidth / tank.width, screenHeight / tank.height);
  const known = display && display.px_per_mm && mmPerPx ? display.px_per_mm * mmPerPx : null;
  const scale = (display && display.scale) || known || fits;
  return {
    scale, width: screenWidth, height: screenHeight,
    left: Math.round((screenWidth - tank.width * scale) / 2),
    top: Math.round((screenHeight - tank.height * scale) / 2),
    warp: projection(display && display.corners, screenWidth, screenHeight),
    warped: Boolean(display && display.corners),
  };
}

// Where a place of the tank is seen, device px from the screen's edge.
function onScreen(view, x, y) {
  const sx = view.left + (x + 0.5) * view.scale, sy = view.top + (y + 0.5) * view.scale;
  if (!view.warped) return [sx, sy];
  const m = view.warp, w = m[6] * sx + m[7] * sy + m[8];
  return [(m[0] * sx + m[1] * sy + m[2]) / w, (m[3] * sx + m[4] * sy + m[5]) / w];
}
