// Numbers of this page, packed by pack.py: base64, deflate, bytes by their place, differences of neighbours.
async function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const { n, width } = packed;
  const numbers = new { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array }[width](n);
  for (let i = 0, sum = 0; i < n; i++) {
    let step = planes[i];
    for (let place = 1; place < width; place++) step += planes[place * n + i] * 2 ** (8 * place);
    numbers[i] = sum = (sum + step) >>> 0; // the array's type cuts it off, as NumPy's did
  }
  return numbers;
}

// A field's value of its quantised step, and its place 0..1 on its colour bar.
function valueOf(field, step) {
  const share = step / 65535;
  return field.log ? field.low * (field.high / field.low) ** share : field.low + (field.high - field.low) * share;
}

function placeOf(field, value) {
  const [low, high] = field.bar;
  if (field.barLog) return Math.log(Math.max(value, 1e-30) / low) / Math.log(high / low);
  return (value - low) / (high - low);
}

function told(value) {
  const size = Math.abs(value);
  if (value && (size < 1e-3 || size >= 1e7)) return value.toExponential(3);
  return size >= 1000 ? Math.round(value).toLocaleString("en") : String(Number(value.toPrecision(4)));
}

const tenths = (mm) => mm.toFixed(1).replace(/^-0\.0$/, "0.0");
