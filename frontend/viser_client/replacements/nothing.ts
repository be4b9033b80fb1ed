// In place of viser's panel, and of kinds of nodes that no scene here has (viewer/scene_parts.py).
import { createContext, type ReactNode } from "react";

const nothing = () => null;
export default nothing;
export { nothing as Arrows, nothing as BatchedGlbAsset, nothing as BatchedMesh, nothing as BatchedMeshHoverOutlines };
export { nothing as SingleGlbAsset, nothing as SkinnedMesh };
export { nothing as BrowserWarning, nothing as CommandPalette, nothing as Titlebar, nothing as ViserModal };
export { nothing as CameraFrustumComponent, nothing as HDRJPGEnvironment, nothing as SplatObject };
export { nothing as IconCheck, nothing as IconDownload, nothing as toMantineColor };
export { nothing as PlaybackFromEmbedData, nothing as PlaybackFromFile };

const children = (props: { children?: ReactNode }) => props.children;
export { children as MacWindowWrapper, children as SplatRenderContext };

export const theme = {}; // of AppTheme.ts
export const GaussianSplatsContext = createContext({ meshPropsRef: { current: null }, updateCamera: { current: null } });
