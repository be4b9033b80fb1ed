// The scenario as the service keeps it, and the way back: what was stored before and what was undone, also after a reload.
import { call } from "../shared/api.js";
import { bodyOf } from "./scenario_requests.js";

const STEPS_AT_MOST = 40;
export const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

export class Kept {
  constructor(id) {
    this.id = id;
    this.body = null;
    this.version = null;
    this.past = [];
    this.future = [];
  }

  // Reads what is stored; true where somebody else has changed it, which is then one more step to undo.
  async read() {
    const stored = await call("GET", `/scenarios/${this.id}`);
    const body = bodyOf(stored),
      before = this.body;
    Object.assign(this, { body, version: stored.updated_at });
    if (before === null) this.recall();
    else if (!same(before, body)) this.remember(before);
    return before !== null && !same(before, body);
  }

  async put(body) {
    const before = this.body;
    await this.send(body);
    this.remember(before);
  }

  undo() {
    return this.step(this.past, this.future);
  }

  redo() {
    return this.step(this.future, this.past);
  }

  // Stores the last of `from`, and keeps what it replaces in `to`; false where there is none.
  async step(from, to) {
    const body = from.at(-1),
      now = this.body;
    if (!body) return false;
    await this.send(body);
    from.pop();
    to.push(now);
    this.note();
    return true;
  }

  // What somebody else has stored since it was read is not overwritten: the service answers 412.
  async send(body) {
    const stored = await call("PUT", `/scenarios/${this.id}`, body, { "If-Match": JSON.stringify(this.version) });
    Object.assign(this, { body: bodyOf(stored), version: stored.updated_at });
  }

  remember(before) {
    this.past.push(before);
    if (this.past.length > STEPS_AT_MOST) this.past.shift();
    this.future = [];
    this.note();
  }

  get place() {
    return `stridelab-steps-${this.id}`;
  }

  note() {
    try {
      sessionStorage.setItem(this.place, JSON.stringify({ body: this.body, past: this.past, future: this.future }));
    } catch {
      sessionStorage.removeItem(this.place); // there is no room: the way back ends with this page
    }
  }

  // The steps of this tab before it was loaded anew, unless the scenario has been changed elsewhere since.
  recall() {
    const noted = JSON.parse(sessionStorage.getItem(this.place) ?? "null");
    if (noted && same(noted.body, this.body)) Object.assign(this, { past: noted.past, future: noted.future });
  }
}
