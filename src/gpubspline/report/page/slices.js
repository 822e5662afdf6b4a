// Slices of the CT across its own axes, with the outline of the mesh over them.
async function makeSlices(ct, body, outline) {
  const grey = await unpack(ct.grey), index = indices(ct.affine, body.mm);
  const [ni, nj] = ct.shape, strides = [1, ni, ni * nj];
  const spacing = [0, 1, 2].map((a) => Math.hypot(...[0, 1, 2].map((x) => ct.affine[x][a])));
  document.getElementById("slices").hidden = ct.views.length === 0;
  const trio = document.querySelector(".trio"); // all at one scale: as wide as they are in mm
  const size = ct.views.map((view) => [view.right, view.up].map((axis) => ct.shape[axis] * spacing[axis]));
  const total = size.reduce((t, [wide]) => t + wide, 0), tallest = Math.max(...size.map(([, high]) => high));
  trio.style.setProperty("--shape", total / tallest);
  const draws = ct.views.map((view, place) => {
    const figure = document.createElement("figure");
    figure.style.flex = `${size[place][0]} 1 0`;
    const [canvas, slider, caption] = ["canvas", "input", "figcaption"].map((tag) => figure.appendChild(document.createElement(tag)));
    canvas.dataset.view = slider.dataset.view = view.name;
    Object.assign(slider, { type: "range", min: 0, max: ct.shape[view.across] - 1, value: bestSlice(body, index[view.across], ct.shape[view.across]) });
    slider.hidden = ct.shape[view.across] === 1;
    slider.setAttribute("aria-label", `${view.name} slice`);
    trio.appendChild(figure);
    const draw = () => {
      const n = Number(slider.value);
      drawSlice(canvas, view, ct, n, (a, b) => grey[n * strides[view.across] + a * strides[view.right] + b * strides[view.up]], spacing);
      drawOutline(canvas, view, ct, outline ? edgesOf(outline, index, view, n) : crossings(body, index, view, n), outline);
      const mm = [0, 1, 2].map((x) => ct.affine[x][3] + [0, 1, 2].reduce((t, a) => t + ct.affine[x][a] * (a === view.across ? n : ct.shape[a] / 2), 0));
      caption.textContent = `${view.name}, slice ${n + 1} of ${ct.shape[view.across]}, ${view.patient} = ${tenths(mm["xyz".indexOf(view.patient)])} mm at its middle`;
    };
    slider.addEventListener("input", draw);
    return draw;
  });
  const redraw = () => draws.forEach((draw) => draw()); // letters and lines are as large on any screen
  redraw();
  window.addEventListener("resize", redraw);
  document.getElementById("sliceNote").textContent = `Grey runs from ${ct.window[0]} to ${ct.window[1]} HU. ${ct.note}`;
}

// Index coordinates i, j, k of the nodes.
function indices(affine, mm) {
  const m = affine.slice(0, 3).map((row) => row.slice(0, 3));
  const minor = (r, c) => {
    const [a, b] = [0, 1, 2].filter((v) => v !== r), [p, q] = [0, 1, 2].filter((v) => v !== c);
    return (m[a][p] * m[b][q] - m[a][q] * m[b][p]) * ((r + c) % 2 ? -1 : 1);
  };
  const det = [0, 1, 2].reduce((t, c) => t + m[0][c] * minor(0, c), 0);
  return [0, 1, 2].map((axis) => Float32Array.from(mm[0], (_, n) =>
    [0, 1, 2].reduce((t, x) => t + (minor(x, axis) / det) * (mm[x][n] - affine[x][3]), 0)));
}

const perPixel = (canvas) => canvas.width / (canvas.clientWidth || canvas.width); // of the screen

function bestSlice(body, along, count) {
  let total = 0;
  for (const value of along) total += value;
  return Math.max(0, Math.min(count - 1, Math.round(total / along.length)));
}

function drawSlice(canvas, view, ct, n, value, spacing) {
  const [wide, high] = [ct.shape[view.right], ct.shape[view.up]];
  const image = new ImageData(wide, high);
  for (let b = 0; b < high; b++) {
    for (let a = 0; a < wide; a++) {
      const v = value(view.flipRight ? wide - 1 - a : a, view.flipUp ? high - 1 - b : b);
      image.data.set([v, v, v, 255], 4 * (b * wide + a));
    }
  }
  const flat = new OffscreenCanvas(wide, high);
  flat.getContext("2d").putImageData(image, 0, 0);
  const size = [wide * spacing[view.right], high * spacing[view.up]], scale = 720 / Math.max(...size);
  [canvas.width, canvas.height] = size.map((mm) => Math.max(1, Math.round(mm * scale)));
  const pen = canvas.getContext("2d");
  pen.imageSmoothingEnabled = true;
  pen.drawImage(flat, 0, 0, canvas.width, canvas.height);
  pen.font = `600 ${14 * perPixel(canvas)}px system-ui, sans-serif`;
  pen.fillStyle = "#ffd54f";
  const [left, right, top, bottom] = view.letters, { width: w, height: h } = canvas;
  for (const [letter, x, y, align, line] of [[left, 8, h / 2, "left", "middle"], [right, w - 8, h / 2, "right", "middle"],
    [top, w / 2, 6, "center", "top"], [bottom, w / 2, h - 6, "center", "bottom"]]) {
    [pen.textAlign, pen.textBaseline] = [align, line];
    pen.fillText(letter, x, y);
  }
}

// Pieces of line, each two points (right, up) in voxels, where the surface crosses a slice.
function crossings(body, index, view, n) {
  const across = index[view.across], lines = [];
  for (let face = 0; face < body.scene.surface; face++) {
    const nodes = [0, 1, 2, 3].map((corner) => body.node(face, corner));
    const heights = nodes.map((node) => across[node] - n);
    if (Math.min(...heights) > 0 || Math.max(...heights) < 0) continue;
    const met = [];
    for (let e = 0; e < 4; e++) {
      const [one, other, h, g] = [nodes[e], nodes[(e + 1) % 4], heights[e], heights[(e + 1) % 4]];
      if (h >= 0 === g >= 0) continue;
      met.push([view.right, view.up].map((axis) => index[axis][one] + (h / (h - g)) * (index[axis][other] - index[axis][one])));
    }
    for (let pair = 0; pair + 1 < met.length; pair += 2) lines.push([met[pair], met[pair + 1]]);
  }
  return lines;
}

function edgesOf(outline, index, view, n) {
  const lines = [], half = outline.length / 2, at = (node) => [index[view.right][node], index[view.up][node]];
  for (let e = 0; e < half; e++) {
    if (Math.abs(index[view.across][outline[e]] - n) <= 0.5) lines.push([at(outline[e]), at(outline[half + e])]);
  }
  return lines;
}

function drawOutline(canvas, view, ct, lines) {
  const pen = canvas.getContext("2d"), [wide, high] = [ct.shape[view.right], ct.shape[view.up]];
  const x = (v) => (((view.flipRight ? wide - 1 - v : v) + 0.5) * canvas.width) / wide;
  const y = (v) => (((view.flipUp ? high - 1 - v : v) + 0.5) * canvas.height) / high;
  pen.lineWidth = 1.4 * perPixel(canvas);
  pen.strokeStyle = "#4fc3f7";
  pen.beginPath();
  for (const [[a, b], [c, d]] of lines) {
    pen.moveTo(x(a), y(b));
    pen.lineTo(x(c), y(d));
  }
  pen.stroke();
}
