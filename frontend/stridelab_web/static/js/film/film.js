// A film of the scene: frame after frame is drawn in the chosen size and encoded, however long that takes.
import { drawPicture, pictureSize } from "../viewer/snapshot.js";
import { choosePalette, GifWriter } from "./gif.js";
import { webmFile } from "./webm.js";
import { translate } from "../shared/translate.js";

const CODECS = [
  { name: "vp09.00.40.08", label: "V_VP9" },
  { name: "vp8", label: "V_VP8" },
];
const BITS_PER_PIXEL = 0.25,
  KEY_EVERY_S = 2,
  MAX_QUEUE = 4,
  PALETTE_FRAMES = 5,
  MAX_GIF_PIXELS = 60e6, // of all frames together, which are compressed in this page
  DRAW_TIMEOUT_MS = 5000;

export const FORMATS = {
  webm: { title: "WebM", mediaType: "video/webm" },
  gif: { title: "GIF", mediaType: "image/gif" },
};

// Times of the frames from `from_s` to `to_s` at a rate and a speed, on the timeline of the scene.
/** @param {number} from_s @param {number} to_s @param {number} rate_hz @param {number} speed */
export function frameTimes(from_s, to_s, rate_hz, speed) {
  const n = Math.max(Math.floor(((to_s - from_s) / speed) * rate_hz + 1e-6), 0) + 1;
  return Array.from({ length: n }, (_, k) => from_s + (k * speed) / rate_hz);
}

// The codec of this browser for a film of this size, or null.
/** @param {number} width @param {number} height */
export async function videoCodec(width, height) {
  if (typeof VideoEncoder === "undefined") return null;
  for (const codec of CODECS) {
    const support = await VideoEncoder.isConfigSupported({ codec: codec.name, width, height }).catch(() => null);
    if (support?.supported) return codec;
  }
  return null;
}

// Draws the scene at times and resolves to a Blob. `source`: viser(), seek(t_s) draws an instant, settled() whether it is
// drawn. `progress(k, n)` is called before every frame and returns false to stop; then the result is null.
/**
 * @param {FilmSource} source
 * @param {{ format: "webm" | "gif", scale: number, rate_hz: number, times_s: number[] }} options
 * @param {(k: number, n: number) => boolean} progress
 */
export async function makeFilm(source, { format, scale, rate_hz, times_s }, progress) {
  const [width, height] = pictureSize(source.viser(), scale).map((length) => 2 * Math.round(length / 2));
  const encoder =
    format === "gif"
      ? gifEncoder(width, height, rate_hz, times_s.length)
      : await webmEncoder(width, height, rate_hz, times_s.length);
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width, height });
  const context = /** @type {CanvasRenderingContext2D} */ (
    canvas.getContext("2d", { willReadFrequently: format === "gif" })
  );
  const draw = async (/** @type {number} */ k) => {
    source.seek(times_s[k]);
    await settle(source);
    drawPicture(source.viser(), context, width, height, false);
  };
  try {
    await encoder.prepare(draw, context);
    for (let k = 0; k < times_s.length; k += 1) {
      if (!progress(k, times_s.length)) return null;
      await draw(k);
      await encoder.add(canvas, context, k);
    }
    return new Blob(/** @type {BlobPart[]} */ (await encoder.finish()), { type: FORMATS[format].mediaType });
  } finally {
    encoder.close();
  }
}

// Resolves once viser has placed what was moved.
/** @param {FilmSource} source */
async function settle(source) {
  const until_ms = performance.now() + DRAW_TIMEOUT_MS;
  do {
    source.redraw();
    await new Promise((done) => requestAnimationFrame(done));
    if (performance.now() > until_ms)
      throw new Error(translate("The scene is not drawn. Keep its window in view while it is filmed."));
  } while (!source.settled());
}

/** @param {number} width @param {number} height @param {number} rate_hz @param {number} n */
async function webmEncoder(width, height, rate_hz, n) {
  const codec = await videoCodec(width, height);
  if (!codec)
    throw new Error(translate("This browser cannot encode a WebM film of this size. Choose GIF or a smaller size."));
  /** @type {{ data: Uint8Array<ArrayBuffer>, t_ms: number, isKey: boolean }[]} */
  const chunks = [];
  /** @type {Error | null} */
  let failure = null;
  const encoder = new VideoEncoder({
    output: (chunk) => {
      const data = new Uint8Array(chunk.byteLength);
      chunk.copyTo(data);
      chunks.push({ data, t_ms: Math.round(chunk.timestamp / 1000), isKey: chunk.type === "key" });
    },
    error: (error) => {
      failure = error;
    },
  });
  const bitrate = Math.round(width * height * rate_hz * BITS_PER_PIXEL);
  encoder.configure({ codec: codec.name, width, height, bitrate, framerate: rate_hz });
  return {
    prepare: async () => {},
    add: async (
      /** @type {HTMLCanvasElement} */ canvas,
      /** @type {CanvasRenderingContext2D} */ _context,
      /** @type {number} */ k,
    ) => {
      const frame = new VideoFrame(canvas, { timestamp: Math.round((1e6 * k) / rate_hz) });
      encoder.encode(frame, { keyFrame: k % Math.round(KEY_EVERY_S * rate_hz) === 0 });
      frame.close();
      while (encoder.encodeQueueSize > MAX_QUEUE) await new Promise((done) => setTimeout(done, 5));
      if (failure) throw failure;
    },
    finish: async () => {
      await encoder.flush();
      if (failure) throw failure;
      const about = { codec: codec.label, width, height, duration_ms: (1e3 * n) / rate_hz, app: "stridelab" };
      return [webmFile(about, chunks)];
    },
    close: () => encoder.state !== "closed" && encoder.close(),
  };
}

/** @param {number} width @param {number} height @param {number} rate_hz @param {number} n */
function gifEncoder(width, height, rate_hz, n) {
  if (width * height * n > MAX_GIF_PIXELS)
    throw new Error(
      translate("This GIF would be too large. Choose a smaller size, fewer frames or a shorter range, or WebM."),
    );
  /** @type {GifWriter} */
  let writer;
  const pixels = (/** @type {CanvasRenderingContext2D} */ context) => context.getImageData(0, 0, width, height).data;
  return {
    // Some frames are drawn twice: the palette must be known before the first one is written.
    prepare: async (/** @type {any} */ draw, /** @type {CanvasRenderingContext2D} */ context) => {
      const samples = [];
      for (let i = 0; i < Math.min(PALETTE_FRAMES, n); i += 1) {
        await draw(Math.round((i * (n - 1)) / Math.max(Math.min(PALETTE_FRAMES, n) - 1, 1)));
        samples.push(pixels(context));
      }
      writer = new GifWriter(width, height, choosePalette(samples), Math.round(100 / rate_hz));
    },
    add: async (/** @type {HTMLCanvasElement} */ _canvas, /** @type {CanvasRenderingContext2D} */ context) =>
      writer.addFrame(pixels(context)),
    finish: async () => writer.finish(),
    close: () => {},
  };
}
