// The page: controls, what a click says, and what a row of the worst elements shows.
const byId = (id) => document.getElementById(id);

async function start() {
  const data = JSON.parse(byId("data").textContent), scene = data.scene;
  const body = await makeBody(scene), canvas = byId("mesh");
  const outline = scene.outline && (await unpack(scene.outline));
  if (data.slices) await makeSlices(data.slices, body, outline);
  const painter = makePainter(canvas, body);
  if (!painter) {
    document.querySelector(".stage").innerHTML = "<p class='hint'>This browser has no WebGL 2: the mesh is not drawn.</p>";
    return done();
  }
  const camera = makeCamera(scene.low, scene.high);
  camera.aspect = canvas.clientWidth / canvas.clientHeight;
  camera.reset();
  if (scene.flat) camera.face(thinnest(scene));
  const state = { field: body.fields[0], cut: null, shown: body.shownFaces(null), edges: true, chosen: null };
  byId("sceneNote").textContent = scene.note;

  let asked = 0;
  const draw = () => { // once a frame, however often it is asked for
    if (!asked) asked = requestAnimationFrame(() => { asked = 0; drawNow(); });
  };
  const drawNow = () => {
    camera.aspect = canvas.clientWidth / canvas.clientHeight;
    painter.draw(camera, state.edges);
    drawCompass(camera);
  };
  const refill = () => {
    state.shown = body.shownFaces(state.cut);
    painter.fill("body", state.shown, state.field);
    const worst = state.chosen === null ? [0, 0] : scene.worst[state.chosen];
    painter.fill("chosen", Uint32Array.from({ length: worst[1] - worst[0] }, (_, i) => worst[0] + i), state.field);
    draw();
  };
  const recolour = () => {
    painter.colours(state.field.colours);
    showBar(state.field);
    refill();
  };

  for (const field of body.fields) byId("field").add(new Option(field.label, field.name));
  byId("field").onchange = (event) => {
    state.field = body.fields.find((field) => field.name === event.target.value);
    recolour();
  };
  byId("edges").onchange = (event) => { state.edges = event.target.checked; draw(); };
  byId("reset").onclick = () => {
    camera.reset();
    if (scene.flat) camera.face(thinnest(scene));
    choose(null);
    draw();
  };
  connectCuts(scene, (cut) => { state.cut = cut; byId("mark").hidden = true; refill(); });
  connectPointer(canvas, camera, () => { byId("mark").hidden = true; draw(); }, (x, y) => {
    const found = pickFace(body, state.shown, camera.rows(), x, y);
    if (found) tell(body, found.face, found.node);
    Object.assign(byId("mark"), { hidden: !found });
    Object.assign(byId("mark").style, { left: `${50 + 50 * x}%`, top: `${50 - 50 * y}%` });
  });

  const rows = [...document.querySelectorAll("tr[data-worst]")];
  const choose = (place) => {
    state.chosen = place;
    rows.forEach((row) => row.toggleAttribute("aria-current", Number(row.dataset.worst) === place));
    byId("mark").hidden = true;
    if (place !== null) {
      const first = scene.worst[place][0], nodes = [0, 1, 2, 3].map((corner) => body.node(first, corner));
      camera.middle = [0, 1, 2].map((a) => nodes.reduce((t, node) => t + body.mm[a][node] / 4, 0));
      camera.half = Math.max(camera.half * 1e-3, 6 * faceSize(body, nodes));
      tell(body, first, nodes[0]);
      byId("body").scrollIntoView({ block: "nearest", behavior: "instant" });
    }
    refill();
  };
  for (const row of rows) {
    row.onclick = () => choose(Number(row.dataset.worst));
    row.onkeydown = (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); row.click(); } };
  }
  new ResizeObserver(draw).observe(canvas);
  window.addEventListener("beforeprint", drawNow);
  recolour();
  requestAnimationFrame(() => requestAnimationFrame(done));
}

const done = () => { document.documentElement.dataset.ready = "yes"; };

function thinnest(scene) { // the side of a flat mesh that radiology looks from: from below, from the front, from the left
  const extent = scene.low.map((low, a) => scene.high[a] - low), axis = extent.indexOf(Math.min(...extent));
  return [0, 1, 2].map((a) => (a === axis ? [1, -1, -1][a] : 0));
}

function faceSize(body, nodes) {
  return Math.max(...[0, 1].map((k) => Math.hypot(...[0, 1, 2].map((a) => body.mm[a][nodes[k]] - body.mm[a][nodes[k + 2]]))));
}

function tell(body, face, node) {
  const owner = body.owners[face];
  const parts = [["element", (owner + 1).toLocaleString("en")], ["node", (body.nodes[node] + 1).toLocaleString("en")],
    ["x, y, z (mm)", body.mm.map((values) => tenths(values[node])).join(", ")],
    ...body.fields.map((f) => [f.label, told(valueOf(f, f.steps[f.where === "node" ? node : face]))])];
  const box = byId("pick");
  box.classList.remove("screen");
  box.replaceChildren(...parts.map(([name, value]) => {
    const span = document.createElement("span"), bold = document.createElement("b");
    bold.textContent = value;
    span.append(`${name} `, bold);
    return span;
  }));
}

function showBar(field) {
  byId("barLabel").textContent = field.label;
  byId("barLow").textContent = told(field.bar[0]);
  byId("barHigh").textContent = told(field.bar[1]);
  byId("barColours").style.background = `linear-gradient(to top, ${field.colours.join(",")})`;
}

function connectCuts(scene, use) {
  const place = byId("place");
  byId("cutting").hidden = scene.cuts.length === 0;
  let along = [];
  const show = () => {
    const cut = along[Number(place.value)] || null;
    byId("at").textContent = cut ? `${"xyz"[cut.axis]} = ${tenths(cut.at)} mm` : "";
    use(cut);
  };
  place.oninput = show;
  for (const button of document.querySelectorAll("[data-cut]")) {
    button.onclick = () => {
      document.querySelectorAll("[data-cut]").forEach((other) => other.setAttribute("aria-pressed", other === button));
      along = scene.cuts.filter((cut) => String(cut.axis) === button.dataset.cut);
      Object.assign(place, { max: Math.max(along.length - 1, 0), disabled: along.length === 0 });
      place.value = Math.floor(along.length / 2);
      show();
    };
  }
}

function connectPointer(canvas, camera, moved, clicked) {
  const down = new Map();
  let travelled = 0;
  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (!down.size) travelled = 0;
    down.set(event.pointerId, event);
  };
  canvas.onpointermove = (event) => {
    const before = down.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    const other = [...down.values()].find((each) => each.pointerId !== event.pointerId);
    const mm = (2 * camera.half) / Math.min(canvas.clientWidth, canvas.clientHeight);
    if (other) {
      const apart = (each) => Math.hypot(each.clientX - other.clientX, each.clientY - other.clientY);
      camera.zoom(apart(before) / Math.max(apart(event), 1));
    } else if (event.shiftKey || event.buttons & 4) camera.move(dx * mm, dy * mm);
    else camera.turn(dx * 0.01, dy * 0.01);
    travelled += Math.abs(dx) + Math.abs(dy);
    down.set(event.pointerId, event);
    if (travelled > 4) moved();
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => {
    const began = down.delete(event.pointerId);
    if (!began || down.size || travelled > 4 || event.type === "pointercancel") return;
    const box = canvas.getBoundingClientRect();
    clicked((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(event.deltaY * 0.0012));
    moved();
  }, { passive: false });
  canvas.onkeydown = (event) => {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    const zoom = { "+": 0.9, "-": 1.1 }[event.key];
    if (turns) camera.turn(...turns);
    else if (zoom) camera.zoom(zoom);
    else return;
    event.preventDefault();
    moved();
  };
}

function drawCompass(camera) { // left, posterior, superior
  const { right, up } = camera.axes();
  byId("compass").innerHTML = ["L", "P", "S"].map((letter, a) => {
    const [x, y] = [right[a], -up[a]];
    if (Math.hypot(x, y) < 0.15) return "";
    return `<line x1="60" y1="60" x2="${60 + 36 * x}" y2="${60 + 36 * y}"/><text x="${60 + 49 * x}" y="${60 + 49 * y}">${letter}</text>`;
  }).join("");
}

start();
