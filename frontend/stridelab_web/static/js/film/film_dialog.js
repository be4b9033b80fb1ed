// A dialog that saves a film of a range of the timeline in a chosen format, size, rate and speed.
import { saveBlob } from "../shared/elements.js";
import { setActive } from "../shared/focus.js";
import { pictureSize } from "../viewer/snapshot.js";
import { frameTimes, makeFilm, videoCodec } from "./film.js";
import { translate } from "../shared/translate.js";

const SCALES = [0.5, 1, 1.5, 2];

export class FilmDialog {
  // `source` as of `makeFilm`, with name(), range_s() (the played range), speed(), and restore() after the film.
  /** @param {PageElement} dialog @param {FilmSource} source */
  constructor(dialog, source) {
    this.dialog = dialog;
    this.source = source;
    const part = (/** @type {string} */ name) => dialog.querySelector(`[data-${name}]`);
    this.form = dialog.querySelector("form");
    this.bar = part("film-progress");
    this.status = part("said");
    this.saveButton = part("save");
    this.isStopped = false;
    this.isFilming = false;
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.saveFilm();
    });
    this.form.addEventListener("input", () => this.describe());
    part("close").addEventListener("click", () => dialog.close());
    dialog.addEventListener("close", () => {
      this.isStopped = true;
    });
  }

  // Opens the dialog with the played range and the sizes for the present window.
  async open() {
    const { elements } = this.form,
      viser = this.source.viser(),
      before = elements.size.value || "1";
    elements.size.replaceChildren(
      ...SCALES.map(
        (scale) =>
          new Option(
            translate("%(scale)s×: %(size)s pixels", { scale, size: pictureSize(viser, scale).join(" × ") }),
            String(scale),
          ),
      ),
    );
    elements.size.value = before;
    const [from_s, to_s] = this.source.range_s();
    elements.from.value = from_s.toFixed(2);
    elements.to.value = to_s.toFixed(2);
    elements.speed.value = String(this.source.speed());
    this.bar.hidden = true;
    this.describe();
    this.dialog.showModal();
    const [width, height] = pictureSize(viser, 1);
    const webm = elements.format.querySelector("option[value=webm]");
    webm.disabled = !(await videoCodec(width, height));
    if (webm.disabled) elements.format.value = "gif";
  }

  times_s() {
    const { from, to, rate, speed } = this.form.elements;
    const [from_s, to_s] = [from, to].map((field) => field.valueAsNumber);
    return from_s < to_s ? frameTimes(from_s, to_s, Number(rate.value), Number(speed.value)) : [];
  }

  describe() {
    const n = this.times_s().length,
      rate_hz = Number(this.form.elements.rate.value);
    setActive(this.saveButton, n > 0 && !this.isFilming);
    this.status.textContent = n
      ? translate("%(frames)s frames, %(duration)s s", { frames: n, duration: (n / rate_hz).toFixed(1) })
      : translate("The range is empty.");
  }

  async saveFilm() {
    const { format, size, rate } = this.form.elements;
    Object.assign(this, { isFilming: true, isStopped: false });
    setActive(this.saveButton, false);
    this.bar.hidden = false;
    try {
      const wanted = {
        format: /** @type {"webm" | "gif"} */ (format.value),
        scale: Number(size.value),
        rate_hz: Number(rate.value),
        times_s: this.times_s(),
      };
      const blob = await makeFilm(this.source, wanted, (k, n) => this.showProgress(k, n));
      if (!blob) return;
      saveBlob(blob, `${this.source.name()}.${format.value}`);
      this.dialog.close();
    } catch (error) {
      this.status.textContent = /** @type {Error} */ (error).message;
    } finally {
      this.isFilming = false;
      setActive(this.saveButton, true);
      this.bar.hidden = true;
      this.source.restore();
    }
  }

  /** @param {number} k @param {number} n */
  showProgress(k, n) {
    this.bar.value = String(k / n);
    this.status.textContent = translate("Frame %(frame)s of %(number)s. Close stops the film.", {
      frame: k + 1,
      number: n,
    });
    return !this.isStopped;
  }
}
