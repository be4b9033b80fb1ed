// Whether WebGL draws on the processor, because there is no graphics card or it is not used. Pictures are then cheaper:
// without antialiasing, and with light that falls off with the angle only, in place of a physical model of the surface.
const ON_PROCESSOR = /SwiftShader|llvmpipe|softpipe|Basic Render|Software/i;

let isSoftware: boolean | undefined;

// Asks a context of one pixel, which takes 5 to 11 ms there; that of the scene cannot change its antialiasing.
export function drawsOnProcessor(): boolean {
  isSoftware ??= ON_PROCESSOR.test(rendererName());
  return isSoftware;
}

function rendererName(): string {
  const gl = globalThis.OffscreenCanvas && new OffscreenCanvas(1, 1).getContext("webgl2", { antialias: false });
  if (!gl) return "";
  const details = gl.getExtension("WEBGL_debug_renderer_info");
  const name = gl.getParameter(details ? details.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return String(name);
}
