// Starts viser's client (viser_client.py): the application takes its decoder of messages from this name.
const { href: decoder } = document.querySelector("link[rel=preload]"),
  { href: application } = document.querySelector("link[rel=modulepreload]");

globalThis.__viserZstdWasm = await WebAssembly.compileStreaming(fetch(decoder));
await import(application);
