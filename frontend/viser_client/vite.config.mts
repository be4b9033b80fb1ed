// Builds the client of static/viser from the sources in the installed viser package (scripts/viser-client).
import { resolve } from "node:path";
import react from "@vitejs/plugin-react";
import { defineConfig, type Plugin } from "vite";

const { VISER_CLIENT: sources = "", VISER_BUILT: built = "" } = process.env;

// Parts of viser's sources, by the ends of their names, and packages, in place of which a file of `replacements` is built.
const REPLACEMENTS = {
  "dock_surface.tsx": ["/ControlPanelDock"],
  "mantine_core.tsx": ["@mantine/core"],
  "mantine_hooks.ts": ["@mantine/hooks"],
  "mantine_notifications.ts": ["@mantine/notifications"],
  "zstd.ts": ["./zstd"],
  "nothing.ts": [
    ...[".css", "/potsdamer_platz_1k.jpg", "/logo.svg", "/AppTheme", "@tabler/icons-react"],
    ...["/ControlPanel", "/Generated", "/Titlebar", "./Modal", "/CommandPalette", "/BrowserWarning"],
    ...["/MacWindowWrapper", "/FilePlayback", "/HDRJPGEnvironment", "/GaussianSplats", "/GaussianSplatsHelpers"],
    ...["/colorUtils", "/SingleGlbAsset", "/BatchedGlbAsset", "/SkinnedMesh", "/BatchedMesh", "/CameraFrustumVariants"],
    ...["./Arrows", "/BatchedMeshHoverOutlines"],
  ],
};

// react-three-fiber's canvas registers every class of three.js, which keeps them all in the build; viser registers those
// that it draws (src/r3f-extend.ts), and its own build leaves this call out, too.
const REGISTERS_ALL = "React.useMemo(() => extend(THREE), [])";

function replaceParts(): Plugin {
  return {
    name: "replace-parts",
    enforce: "pre",
    resolveId(name) {
      const entry = Object.entries(REPLACEMENTS).find(([, ends]) => ends.some((end) => name.endsWith(end)));
      return entry && resolve(sources, "replacements", entry[0]);
    },
    transform: (code) => (code.includes(REGISTERS_ALL) ? code.replace(REGISTERS_ALL, "undefined") : undefined),
  };
}

export default defineConfig({
  root: sources,
  plugins: [replaceParts(), react()],
  worker: { format: "es", plugins: () => [replaceParts()] },
  build: {
    outDir: built,
    emptyOutDir: true,
    target: "es2022",
    license: { fileName: "licenses.md" },
    rollupOptions: {
      input: resolve(sources, "src/index.tsx"),
      output: { codeSplitting: false, entryFileNames: "client.js" },
    },
  },
});
