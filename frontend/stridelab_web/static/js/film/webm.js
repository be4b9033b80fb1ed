// A WebM file (Matroska, RFC 9559) of one video track, from chunks with a time, as a browser's VideoEncoder makes them.

/** @typedef {{ data: Uint8Array, t_ms: number, isKey: boolean }} Chunk */

const ID = {
  header: 0x1a45dfa3,
  version: 0x4286,
  readVersion: 0x42f7,
  maxIdLength: 0x42f2,
  maxSizeLength: 0x42f3,
  docType: 0x4282,
  docTypeVersion: 0x4287,
  docTypeReadVersion: 0x4285,
  segment: 0x18538067,
  info: 0x1549a966,
  timestampScale: 0x2ad7b1,
  duration: 0x4489,
  muxingApp: 0x4d80,
  writingApp: 0x5741,
  tracks: 0x1654ae6b,
  track: 0xae,
  trackNumber: 0xd7,
  trackUid: 0x73c5,
  trackType: 0x83,
  codec: 0x86,
  video: 0xe0,
  pixelWidth: 0xb0,
  pixelHeight: 0xba,
  cluster: 0x1f43b675,
  timestamp: 0xe7,
  simpleBlock: 0xa3,
};
const NS_PER_MS = 1_000_000,
  VIDEO = 1,
  MAX_BLOCK_TIME_MS = 30_000, // the time of a block in its cluster has 16 bits
  KEY_FLAG = 0x80;

/** @param {Uint8Array[]} parts */
function join(parts) {
  const whole = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}

// A number in as many bytes as it needs, at least `length`.
/** @param {number} value @param {number} [length] */
function bytesOf(value, length = 1) {
  const bytes = [];
  for (let rest = value; rest > 0 || bytes.length < length; rest = Math.floor(rest / 256)) bytes.unshift(rest % 256);
  return new Uint8Array(bytes);
}

// The size of an element in eight bytes.
/** @param {number} size */
const sizeBytes = (size) => join([new Uint8Array([1]), bytesOf(size, 7)]);

/** @param {number} id @param {Uint8Array[]} parts */
function element(id, ...parts) {
  const content = join(parts);
  return join([bytesOf(id), sizeBytes(content.length), content]);
}

/** @param {string} text */
const textBytes = (text) => new TextEncoder().encode(text);

/** @param {number} value */
function floatBytes(value) {
  const bytes = new Uint8Array(8);
  new DataView(bytes.buffer).setFloat64(0, value);
  return bytes;
}

// The file. `codec` is "V_VP8" or "V_VP9"; the chunks are in order, the first one is a key frame.
/**
 * @param {{ codec: string, width: number, height: number, duration_ms: number, app: string }} about
 * @param {Chunk[]} chunks
 */
export function webmFile({ codec, width, height, duration_ms, app }, chunks) {
  const header = element(
    ID.header,
    element(ID.version, bytesOf(1)),
    element(ID.readVersion, bytesOf(1)),
    element(ID.maxIdLength, bytesOf(4)),
    element(ID.maxSizeLength, bytesOf(8)),
    element(ID.docType, textBytes("webm")),
    element(ID.docTypeVersion, bytesOf(4)),
    element(ID.docTypeReadVersion, bytesOf(2)),
  );
  const info = element(
    ID.info,
    element(ID.timestampScale, bytesOf(NS_PER_MS)),
    element(ID.duration, floatBytes(duration_ms)),
    element(ID.muxingApp, textBytes(app)),
    element(ID.writingApp, textBytes(app)),
  );
  const video = element(ID.video, element(ID.pixelWidth, bytesOf(width)), element(ID.pixelHeight, bytesOf(height)));
  const track = element(
    ID.track,
    element(ID.trackNumber, bytesOf(1)),
    element(ID.trackUid, bytesOf(1)),
    element(ID.trackType, bytesOf(VIDEO)),
    element(ID.codec, textBytes(codec)),
    video,
  );
  return join([header, element(ID.segment, info, element(ID.tracks, track), ...clusters(chunks))]);
}

// A cluster begins at every key frame, and before its blocks would be too late for it.
/** @param {Chunk[]} chunks */
function clusters(chunks) {
  /** @type {{ start_ms: number, blocks: Uint8Array[] }[]} */
  const groups = [];
  for (const { data, t_ms, isKey } of chunks) {
    const last = groups[groups.length - 1];
    if (!last || isKey || t_ms - last.start_ms > MAX_BLOCK_TIME_MS) groups.push({ start_ms: t_ms, blocks: [] });
    const { start_ms, blocks } = groups[groups.length - 1];
    const head = new Uint8Array([0x80 | 1, ...bytesOf(t_ms - start_ms, 2), isKey ? KEY_FLAG : 0]);
    blocks.push(element(ID.simpleBlock, head, data));
  }
  return groups.map(({ start_ms, blocks }) => element(ID.cluster, element(ID.timestamp, bytesOf(start_ms)), ...blocks));
}
