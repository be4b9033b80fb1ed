// An animated GIF (GIF89a) of frames of RGBA pixels: one palette for all frames, and pixels that stay are left out.

const COLOURS = 255, // and one index for transparent pixels
  TRANSPARENT = 255,
  BITS = 5, // of each channel in the histogram
  MAX_CODE_BITS = 12,
  LOOP = [0x21, 0xff, 11, ...new TextEncoder().encode("NETSCAPE2.0"), 3, 1, 0, 0, 0];

/** @param {number} r @param {number} g @param {number} b */
const cellOf = (r, g, b) => ((r >> 3) << 10) | ((g >> 3) << 5) | (b >> 3);

// At most 255 colours for frames of RGBA pixels, by median cut.
/** @param {Uint8ClampedArray[]} frames @returns {number[][]} */
export function choosePalette(frames) {
  const counts = new Uint32Array(1 << (3 * BITS));
  for (const frame of frames)
    for (let i = 0; i < frame.length; i += 4) counts[cellOf(frame[i], frame[i + 1], frame[i + 2])] += 1;
  const cells = [...counts.keys()].filter((cell) => counts[cell]);
  /** @param {number} cell */
  const colour = (cell) => [(cell >> 10) & 31, (cell >> 5) & 31, cell & 31];
  let boxes = [cells];
  while (boxes.length < COLOURS) {
    const spans = boxes.map((box) => widest(box.map(colour)));
    const [at] = boxes
      .map((box, k) => /** @type {[number, number]} */ ([k, box.length > 1 ? spans[k].width * weight(box) : -1]))
      .reduce((best, each) => (each[1] > best[1] ? each : best), [-1, 0]);
    if (at < 0) break;
    const sorted = boxes[at].toSorted((a, b) => colour(a)[spans[at].axis] - colour(b)[spans[at].axis]);
    const half = splitIndex(sorted);
    boxes = [...boxes.toSpliced(at, 1), sorted.slice(0, half), sorted.slice(half)];
  }
  return boxes.map((box) => {
    const total = weight(box);
    return [0, 1, 2].map((k) =>
      Math.round(box.reduce((sum, cell) => sum + counts[cell] * ((colour(cell)[k] * 255) / 31), 0) / total),
    );
  });

  /** @param {number[]} box */
  function weight(box) {
    return box.reduce((sum, cell) => sum + counts[cell], 0);
  }

  // Where half of the pixels of the sorted cells are reached, with at least one cell on both sides.
  /** @param {number[]} sorted */
  function splitIndex(sorted) {
    const half = weight(sorted) / 2;
    let sum = 0;
    const at = sorted.findIndex((cell) => {
      sum += counts[cell];
      return sum >= half;
    });
    return Math.min(Math.max(at, 1), sorted.length - 1);
  }
}

/** @param {number[][]} colours */
function widest(colours) {
  const widths = [0, 1, 2].map((k) => {
    const values = colours.map((colour) => colour[k]);
    return Math.max(...values) - Math.min(...values);
  });
  const width = Math.max(...widths);
  return { axis: widths.indexOf(width), width };
}

export class GifWriter {
  // `palette` as of `choosePalette`; `delay_cs` is the time of a frame in hundredths of a second.
  /** @param {number} width @param {number} height @param {number[][]} palette @param {number} delay_cs */
  constructor(width, height, palette, delay_cs) {
    Object.assign(this, { width, height, palette, delay_cs });
    this.width = width;
    this.height = height;
    this.palette = palette;
    this.delay_cs = delay_cs;
    this.nearest = new Int16Array(1 << (3 * BITS)).fill(-1);
    /** @type {Uint8Array | null} */
    this.shown = null; // the indices of the previous frame
    const table = new Uint8Array(256 * 3);
    table.set(palette.flat());
    /** @type {Uint8Array[]} */
    this.parts = [
      new TextEncoder().encode("GIF89a"),
      new Uint8Array([...word(width), ...word(height), 0xf7, 0, 0]),
      table,
      new Uint8Array(LOOP),
    ];
  }

  /** @param {Uint8ClampedArray} rgba */
  addFrame(rgba) {
    const indices = new Uint8Array(rgba.length / 4);
    for (let i = 0; i < indices.length; i += 1)
      indices[i] = this.indexOf(rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]);
    const { shown } = this;
    const drawn = shown ? indices.map((index, i) => (index === shown[i] ? TRANSPARENT : index)) : indices;
    this.shown = indices;
    const control = [0x21, 0xf9, 4, 0x05, ...word(this.delay_cs), TRANSPARENT, 0]; // each frame stays
    const image = [0x2c, 0, 0, 0, 0, ...word(this.width), ...word(this.height), 0, 8];
    this.parts.push(new Uint8Array([...control, ...image]), subBlocks(compress(drawn)));
  }

  // The file as parts of a Blob.
  finish() {
    return [...this.parts, new Uint8Array([0x3b])];
  }

  // The index of the nearest colour, remembered by cell of the histogram.
  /** @param {number} r @param {number} g @param {number} b */
  indexOf(r, g, b) {
    const cell = cellOf(r, g, b);
    if (this.nearest[cell] < 0) {
      const distances = this.palette.map(
        (colour) => (colour[0] - r) ** 2 + (colour[1] - g) ** 2 + (colour[2] - b) ** 2,
      );
      this.nearest[cell] = distances.indexOf(Math.min(...distances));
    }
    return this.nearest[cell];
  }
}

/** @param {number} value */
const word = (value) => [value & 255, value >> 8];

// LZW with codes of 9 to 12 bits (the root has 8 bits).
/** @param {Uint8Array} indices */
function compress(indices) {
  const clear = 256,
    end = 257;
  /** @type {number[]} */
  const bytes = [];
  let buffer = 0,
    held = 0,
    bits = 9,
    next = end + 1;
  /** @type {Map<number, number>} */
  let codes = new Map();
  /** @param {number} code */
  const emit = (code) => {
    buffer |= code << held;
    held += bits;
    while (held >= 8) {
      bytes.push(buffer & 255);
      buffer >>>= 8;
      held -= 8;
    }
  };
  emit(clear);
  let prefix = indices[0];
  for (let i = 1; i < indices.length; i += 1) {
    const key = (prefix << 8) | indices[i],
      known = codes.get(key);
    if (known !== undefined) {
      prefix = known;
      continue;
    }
    emit(prefix);
    if (next < 1 << MAX_CODE_BITS) {
      codes.set(key, next);
      if (next === 1 << bits) bits += 1;
      next += 1;
    } else {
      emit(clear);
      codes = new Map();
      bits = 9;
      next = end + 1;
    }
    prefix = indices[i];
  }
  emit(prefix);
  emit(end);
  if (held > 0) bytes.push(buffer & 255);
  return bytes;
}

/** @param {number[]} bytes */
function subBlocks(bytes) {
  const blocks = [];
  for (let at = 0; at < bytes.length; at += 255) {
    const part = bytes.slice(at, at + 255);
    blocks.push(part.length, ...part);
  }
  return new Uint8Array([...blocks, 0]);
}
