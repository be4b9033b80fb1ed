// Decodes `frames.bin`: a JSON layout, then integer multiples of a step as second differences, column by column
// (scene/frame_codec.py).

const LENGTH_BYTES = 4;

// The layout, and the values as one row per frame, NaN where a value is absent.
/** @param {ArrayBuffer} buffer */
export function decodeFrames(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const layout = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, LENGTH_BYTES, length)));
  return [layout, decodeValues(buffer, LENGTH_BYTES + length, layout)];
}

/** @param {ArrayBuffer} buffer @param {number} offset @param {{ n_frames: number, width: number, bits: number[] }} layout */
function decodeValues(buffer, offset, { n_frames, width, bits }) {
  const size = n_frames * width,
    values = new Float32Array(size);
  const [absent, ...bytes] = [0, 1, 2, 3, 4].map((k) => new Uint8Array(buffer, offset + k * size, size));
  for (let column = 0; column < width; column += 1) {
    const step = 2 ** -bits[column];
    let value = 0,
      difference = 0;
    for (let frame = 0; frame < n_frames; frame += 1) {
      const index = column * n_frames + frame;
      const unsigned =
        (bytes[0][index] | (bytes[1][index] << 8) | (bytes[2][index] << 16) | (bytes[3][index] << 24)) >>> 0;
      difference += (unsigned >>> 1) ^ -(unsigned & 1);
      value += difference;
      values[frame * width + column] = absent[index] ? NaN : value * step;
    }
  }
  return values;
}
