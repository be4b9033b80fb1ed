// The phases of a scenario as a row of bars: click one, or go from one to the next with the arrow keys.
import { sentenceOfPhase } from "./verdict.js";

const KEYS = { ArrowLeft: (k) => k - 1, ArrowRight: (k) => k + 1, Home: () => 0, End: (_, last) => last };

export class Phases {
  constructor(strip, choose) {
    Object.assign(this, { strip, choose, bars: [] });
    strip.addEventListener("click", (event) => {
      const k = this.bars.indexOf(event.target.closest("button"));
      if (k >= 0) choose(k);
    });
    strip.addEventListener("keydown", (event) => this.step(event));
  }

  step(event) {
    const k = this.bars.indexOf(document.activeElement);
    if (k < 0 || !KEYS[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const to = Math.min(Math.max(KEYS[event.key](k, this.bars.length - 1), 0), this.bars.length - 1);
    this.bars[to].focus();
    this.choose(to);
  }

  show(phases, chosen) {
    if (this.bars.length !== phases.length) this.make(phases);
    for (const [k, bar] of this.bars.entries()) {
      const said = sentenceOfPhase(phases[k], k);
      bar.dataset.kind = phases[k].kind;
      bar.title = said;
      bar.setAttribute("aria-label", said);
      bar.setAttribute("aria-pressed", String(k === chosen));
      bar.tabIndex = k === chosen ? 0 : -1; // one stop for the tab key
    }
  }

  make(phases) {
    this.bars = phases.map((phase, k) => {
      const bar = document.createElement("button");
      bar.type = "button";
      bar.style.flexGrow = String(Math.max(phase.duration_s, 0));
      bar.append(document.createElement("span"));
      bar.firstChild.textContent = String(k);
      return bar;
    });
    this.strip.replaceChildren(...this.bars);
  }
}
