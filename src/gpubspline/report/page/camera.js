// An orthographic camera about a middle, in the patient's frame (LPS): superior is up until it is turned.
function makeCamera(low, high) {
  const middle = low.map((l, a) => (l + high[a]) / 2);
  const size = Math.hypot(...low.map((l, a) => high[a] - l)) || 1;
  const camera = { yaw: 0, pitch: 0, half: 0, middle: [], aspect: 1 };
  const box = [0, 1, 2, 3, 4, 5, 6, 7].map((n) => low.map((l, a) => ((n >> a) & 1 ? high[a] : l)));
  camera.reset = () => {
    camera.yaw = Math.atan2(-0.76, 0.54); // from the patient's front, left and above, as the pictures are
    camera.pitch = 0.37;
    camera.middle = middle.slice();
    camera.fit();
  };
  camera.fit = () => { // all of the body, as near as the window lets it be
    const { right, up } = camera.axes();
    const reach = (axis) => Math.max(...box.map((corner) => Math.abs(corner.reduce((t, v, a) => t + (v - middle[a]) * axis[a], 0))));
    camera.half = 1.04 * Math.max(reach(right) / Math.max(camera.aspect, 1), reach(up) / Math.max(1 / camera.aspect, 1));
  };
  camera.face = (toward) => {
    camera.yaw = Math.hypot(toward[0], toward[1]) > 1e-9 ? Math.atan2(toward[1], toward[0]) : -Math.PI / 2;
    camera.pitch = Math.asin(toward[2] / Math.hypot(...toward));
    camera.fit();
  };
  camera.turn = (dx, dy) => {
    camera.yaw -= dx;
    camera.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, camera.pitch + dy));
  };
  camera.zoom = (factor) => { camera.half = Math.max(size * 1e-3, Math.min(size * 2, camera.half * factor)); };
  camera.axes = () => {
    const [c, s, e, f] = [Math.cos(camera.yaw), Math.sin(camera.yaw), Math.cos(camera.pitch), Math.sin(camera.pitch)];
    return { toward: [c * e, s * e, f], right: [-s, c, 0], up: [-c * f, -s * f, e] };
  };
  camera.move = (dx, dy) => {
    const { right, up } = camera.axes();
    for (let a = 0; a < 3; a++) camera.middle[a] += -dx * right[a] + dy * up[a];
  };
  // rows of the map from mm to the screen: -1..1 across the shorter side, and nearness
  camera.rows = (aspect = camera.aspect) => {
    const { right, up, toward } = camera.axes();
    const wide = 1 / (camera.half * Math.max(aspect, 1)), high = 1 / (camera.half * Math.max(1 / aspect, 1));
    const row = (axis, scale) => [...axis.map((v) => v * scale), -scale * axis.reduce((t, v, a) => t + v * camera.middle[a], 0)];
    return [row(right, wide), row(up, high), row(toward, -1 / (2 * size))];
  };
  camera.reset();
  return camera;
}
