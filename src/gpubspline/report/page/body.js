// The mesh: which faces are shown, drawn by WebGL 2, and which of them lies under a point of the screen.
const VERTEX = `#version 300 es
in vec3 at; in float place; uniform vec4 rows[3]; out vec3 seen; out float t; out vec2 corner;
void main() {
  vec4 p = vec4(at, 1.0);
  seen = vec3(dot(rows[0], p), dot(rows[1], p), dot(rows[2], p));
  int k = gl_VertexID % 6;
  corner = vec2(k == 1 || k == 2 || k == 4 ? 1.0 : 0.0, k == 2 || k == 4 || k == 5 ? 1.0 : 0.0);
  t = place;
  gl_Position = vec4(seen, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float; in vec3 seen; in float t; in vec2 corner; out vec4 colour;
uniform sampler2D colours; uniform float edges, veil; uniform vec2 unit; uniform vec4 paint;
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  if (veil > 0.5 && (p.x + 2 * p.y) % 4 != 0) discard;
  vec3 n = normalize(cross(dFdx(seen) * vec3(unit, 1.0), dFdy(seen) * vec3(unit, 1.0)));
  n *= sign(-n.z);
  float light = 0.66 + 0.34 * max(dot(n, normalize(vec3(-0.35, 0.55, -0.76))), 0.0);
  vec3 base = mix(texture(colours, vec2(clamp(t, 0.0, 1.0) * 31.0 / 32.0 + 0.5 / 32.0, 0.5)).rgb, paint.rgb, paint.a);
  vec2 wide = fwidth(corner), near = min(corner, 1.0 - corner) / max(wide, vec2(1e-6));
  float pixels = 1.0 / max(max(wide.x, wide.y), 1e-6);
  float line = edges * (1.0 - smoothstep(0.4, 1.3, min(near.x, near.y))) * smoothstep(3.0, 9.0, pixels);
  float dark = dot(base, vec3(0.3, 0.59, 0.11)) > 0.3 ? 0.0 : 1.0;
  colour = vec4(mix(base * light, vec3(dark), line * (dark > 0.5 ? 0.22 : 0.45)), 1.0);
}`;
const CORNERS = [0, 1, 2, 0, 2, 3];

async function makeBody(scene) {
  const [points, middle] = [await Promise.all(scene.points.map(unpack)), await Promise.all(scene.middle.map(unpack))];
  const [faces, owners, nodes] = await Promise.all([scene.faces, scene.owners, scene.nodes].map(unpack));
  const fields = await Promise.all(scene.fields.map(async (f) => ({ ...f, steps: await unpack(f.values) })));
  const step = scene.low.map((low, a) => (scene.high[a] - low) / 65535);
  const mm = points.map((steps, a) => Float32Array.from(steps, (s) => scene.low[a] + s * step[a]));
  const total = owners.length, body = { scene, fields, mm, owners, nodes, faces, total };
  body.node = (face, corner) => faces[corner * total + face];

  body.shownFaces = (cut) => { // cut: null, or one of scene.cuts
    const limit = cut && (cut.at - scene.low[cut.axis]) / step[cut.axis], below = cut && scene.keptBelow[cut.axis];
    const kept = [];
    for (let f = 0; f < scene.surface; f++) {
      if (!cut || (middle[cut.axis][f] <= limit) === below) kept.push(f);
    }
    if (cut) for (let f = cut.first; f < cut.last; f++) kept.push(f);
    return Uint32Array.from(kept);
  };
  return body;
}

function makePainter(canvas, body) {
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return null;
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const groups = { body: makeGroup(gl, program), chosen: makeGroup(gl, program) };
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  for (const [name, value] of [["MIN_FILTER", "LINEAR"], ["MAG_FILTER", "LINEAR"], ["WRAP_S", "CLAMP_TO_EDGE"], ["WRAP_T", "CLAMP_TO_EDGE"]]) {
    gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl[value]);
  }
  gl.enable(gl.DEPTH_TEST);

  const painter = {};
  painter.fill = (name, shown, field) => groups[name].fill(body, shown, field);
  painter.colours = (colours) => {
    const bytes = new Uint8Array(colours.flatMap((c) => [1, 3, 5].map((i) => parseInt(c.slice(i, i + 2), 16)).concat(255)));
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, colours.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  };
  painter.draw = (camera, edges) => {
    const scale = window.devicePixelRatio || 1;
    const wide = Math.max(1, Math.round(canvas.clientWidth * scale)), high = Math.max(1, Math.round(canvas.clientHeight * scale));
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    gl.viewport(0, 0, wide, high);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const rows = camera.rows();
    gl.uniform4fv(uniform("rows"), rows.flat());
    // in mm, so that faces are lit as they lie
    const mm = rows.map((row) => 1 / Math.hypot(row[0], row[1], row[2]));
    gl.uniform2f(uniform("unit"), mm[0] / mm[2], mm[1] / mm[2]);
    const chosen = groups.chosen.count > 0;
    gl.uniform1f(uniform("edges"), chosen ? 1 : edges ? 1 : 0);
    if (chosen) {
      gl.uniform1f(uniform("veil"), 0);
      gl.uniform4f(uniform("paint"), 0.85, 0.1, 0.4, 0.8);
      groups.chosen.draw();
    }
    gl.uniform1f(uniform("edges"), edges ? 1 : 0);
    gl.uniform1f(uniform("veil"), chosen ? 1 : 0);
    gl.uniform4f(uniform("paint"), 0, 0, 0, 0);
    groups.body.draw();
  };
  return painter;
}

function makeGroup(gl, program) {
  const array = gl.createVertexArray(), buffers = [gl.createBuffer(), gl.createBuffer()];
  gl.bindVertexArray(array);
  ["at", "place"].forEach((name, i) => {
    const place = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[i]);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 3 - 2 * i, gl.FLOAT, false, 0, 0);
  });
  const group = { count: 0 };
  group.fill = (body, shown, field) => {
    const at = new Float32Array(shown.length * 18), place = new Float32Array(shown.length * 6);
    shown.forEach((face, i) => CORNERS.forEach((corner, k) => {
      const node = body.node(face, corner), v = 6 * i + k;
      for (let a = 0; a < 3; a++) at[3 * v + a] = body.mm[a][node];
      place[v] = placeOf(field, valueOf(field, field.steps[field.where === "node" ? node : face]));
    }));
    [at, place].forEach((data, i) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[i]);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    });
    group.count = shown.length * 6;
  };
  group.draw = () => {
    gl.bindVertexArray(array);
    gl.drawArrays(gl.TRIANGLES, 0, group.count);
  };
  return group;
}

// The face nearest to the viewer under a point (-1..1, -1..1) of the screen, and its corner nearest to the point.
function pickFace(body, shown, rows, x, y) {
  const onScreen = (node) => rows.map((r) => r[0] * body.mm[0][node] + r[1] * body.mm[1][node] + r[2] * body.mm[2][node] + r[3]);
  let best = null;
  for (const face of shown) {
    const p = [0, 1, 2, 3].map((corner) => onScreen(body.node(face, corner)));
    for (const [a, b, c] of [[p[0], p[1], p[2]], [p[0], p[2], p[3]]]) {
      const area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
      if (!area) continue;
      const s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area;
      const t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area;
      if (s < 0 || t < 0 || s + t > 1) continue;
      const depth = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2]);
      if (best && depth >= best.depth) continue;
      const away = p.map((q) => Math.hypot(q[0] - x, q[1] - y));
      best = { face, depth, node: body.node(face, away.indexOf(Math.min(...away))) };
    }
  }
  return best;
}
