// Reads `frames.bin`: whole multiples of a step, column after column, told as second differences (packing.py).

// The numbers as rows of frames, NaN where there is nothing.
export function unpack(buffer, { n_frames, width, bits }) {
  const size = n_frames * width, values = new Float32Array(size);
  const [absent, ...bytes] = [0, 1, 2, 3, 4].map((k) => new Uint8Array(buffer, k * size, size));
  for (let column = 0; column < width; column += 1) {
    const step = 2 ** -bits[column];
    let whole = 0, rise = 0;
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
