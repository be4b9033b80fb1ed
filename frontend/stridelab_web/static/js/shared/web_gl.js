// What the browser offers for drawing in 3D, by a context that is given back at once.

/** @template T @param {(gl: WebGL2RenderingContext | null) => T} read @returns {T} */
function probe(read) {
  const gl = document.createElement("canvas").getContext("webgl2"),
    answer = read(gl);
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return answer;
}

export const hasWebGl2 = () => probe((gl) => gl !== null);

// Whether it draws without a graphics card.
export function isSoftwareRendering() {
  return probe((gl) => {
    const info = gl?.getExtension("WEBGL_debug_renderer_info"),
      renderer = gl && info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
    return /swiftshader|llvmpipe|softpipe|software/i.test(renderer);
  });
}
