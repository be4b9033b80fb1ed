// What the scripts of a page rely on beyond the declarations of the DOM. Templates and scripts belong together: an element
// that a script looks up is taken to be there and to have the fields of a form control, a dialog, a frame or a template.

interface PageElement extends HTMLElement {
  checked: boolean;
  defaultChecked: boolean;
  close(): void;
  cloneNode(deep?: boolean): PageElement;
  closest(selectors: string): PageElement;
  readonly content: { firstElementChild: PageElement };
  readonly dataset: Record<string, string>;
  contentDocument: Document;
  contentWindow: ViserWindow;
  defaultValue?: string;
  disabled: boolean;
  readonly elements: Iterable<PageElement> & Record<string, PageElement>;
  readonly files: FileList;
  href: string;
  indeterminate: boolean;
  readonly lastElementChild: PageElement;
  max: string;
  name: string;
  open: boolean;
  readonly parentElement: PageElement;
  readonly options: HTMLOptionsCollection;
  reset(): void;
  select(): void;
  selectedIndex: number;
  setSelectionRange(start: number, end: number): void;
  showModal(): void;
  type: string;
  readonly validity: ValidityState;
  value: string;
  readonly valueAsNumber: number;
}

// A keyboard shortcut (shared/shortcuts.js says what the fields mean); without `run` it is only listed.
interface Shortcut {
  keys: string[];
  text: string;
  run?: (event: KeyboardEvent) => void;
  ctrl?: boolean;
  page?: boolean;
  always?: boolean;
  shown?: string[];
  when?: () => boolean;
}

// The element of a plot, once plotly.js has drawn into it.
interface PlotElement extends PageElement {
  _fullLayout: any;
  data: any[];
  layout: any;
  on(name: string, listener: (event: any) => void): void;
}

interface ParentNode {
  querySelector(selectors: "progress"): HTMLProgressElement;
  querySelector(selectors: string): PageElement;
  querySelectorAll(selectors: string): NodeListOf<PageElement>;
}

interface Document {
  getElementById(id: "plots" | "maps"): PlotElement;
  getElementById(id: string): PageElement;
}

interface DocumentEventMap {
  instant: CustomEvent<number>; // the cursor of the curves is at this time, in seconds
  seek: CustomEvent<number>; // the cursor is to go there
  span: CustomEvent<[number, number]>; // the curves show this interval, in seconds
}

interface FormData {
  get(name: string): string;
}

// The part of plotly.js that the pages call; the script is served from the installed Python package.
declare const Plotly: {
  newPlot(box: HTMLElement, traces: object[], layout: object, config?: object): Promise<void>;
  react(box: HTMLElement, traces: object[], layout: object, config?: object): Promise<void>;
  relayout(box: HTMLElement, changes: object): Promise<void>;
  restyle(box: HTMLElement, changes: object, indices: number[]): Promise<void>;
};

// The translations of the page's language (languages.py); absent on English pages.
declare var stridelabMessages: Record<string, string | string[]> | undefined;
declare var stridelabSentences: string[] | undefined;
