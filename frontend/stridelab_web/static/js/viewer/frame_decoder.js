// Reads `frames.bin`: a layout, then whole multiples of a step, column after column, as second differences (packing.py).

const LENGTH_BYTES = 4;

// The layout, and the numbers as rows of frames, NaN where there is nothing.
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const layout = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, LENGTH_BYTES, length)));
  return [layout, numbers(buffer, LENGTH_BYTES + length, layout)];
}

function numbers(buffer, begin, { n_frames, width, bits }) {
  const size = n_frames * width,
    values = new Float32Array(size);
  const [absent, ...bytes] = [0, 1, 2, 3, 4].map((k) => new Uint8Array(buffer, begin + k * size, size));
  for (let column = 0; column < width; column += 1) {
    const step = 2 ** -bits[column];
    let whole = 0,
      rise = 0;
    for (let frame = 0; frame < n_frames; frame += 1) {
      const at = column * n_frames + frame;
      const unsigned = (bytes[0][at] | (bytes[1][at] << 8) | (bytes[2][at] << 16) | (bytes[3][at] << 24)) >>> 0;
      rise += (unsigned >>> 1) ^ -(unsigned & 1);
      whole += rise;
      values[frame * width + column] = absent[at] ? NaN : whole * step;
    }
  }
  return values;
}
