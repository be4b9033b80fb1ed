// The canvas alone, without a panel that docks at its sides.
import type { ReactNode } from "react";

export type ControlDockState = Record<string, unknown>;
export const ControlPanelDockSurface = ({ children }: { children?: ReactNode }) => (
  <div style={{ position: "relative", width: "100%", height: "100%" }}>{children}</div>
);
