// Starts viser's client (viser_client.py), which takes its message decoder from a global variable.
const { href: decoder } = document.querySelector("link[rel=preload]"),
  { href: application } = document.querySelector("link[rel=modulepreload]");

globalThis.__viserZstdWasm = await WebAssembly.compileStreaming(fetch(decoder));
await import(application);
