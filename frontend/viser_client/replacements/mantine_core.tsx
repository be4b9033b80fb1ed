// What the scene itself uses of Mantine: boxes, and the colour behind the canvas.
import type { CSSProperties, ReactNode } from "react";

const THEME = { breakpoints: { xs: "36em" }, colors: { dark: { 9: "#141414" } }, primaryColor: "blue" };

type Style = CSSProperties | ((theme: typeof THEME) => CSSProperties);

export const useMantineTheme = () => THEME;
export const createTheme = () => THEME;
export const v8CssVariablesResolver = undefined;
export const useMantineColorScheme = () => ({ setColorScheme() {} });
export const MantineProvider = ({ children }: { children?: ReactNode }) => children;

export function Box({ style, children }: { style?: Style; children?: ReactNode }) {
  return <div style={typeof style === "function" ? style(THEME) : style}>{children}</div>;
}

const nothing = () => null;
export { nothing as Anchor, nothing as Button, nothing as Divider, nothing as Image };
export { nothing as Modal, nothing as Paper, nothing as Progress, nothing as Tooltip };
