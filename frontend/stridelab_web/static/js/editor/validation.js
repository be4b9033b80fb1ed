// Asks the service what it thinks of a scenario that is being changed: one question at a time, and the latest wins.
import { call } from "../shared/api.js";

const EVERY_MS = 120;

export class Judge {
  // `tell(check, body)` gets every answer with what was asked; where there was none, `fail(sentence, body)`. `query()` is
  // what stands behind the address: with `body_checked` the whole body is asked, which takes longer.
  constructor(tell, fail, query = () => "") {
    this.tell = tell;
    this.fail = fail;
    this.query = query;
    this.next = null;
    this.busy = false;
  }

  ask(body) {
    this.next = body;
    if (!this.busy) this.work();
  }

  async work() {
    this.busy = true;
    while (this.next) {
      const body = this.next;
      this.next = null;
      const pause = new Promise((done) => setTimeout(done, EVERY_MS));
      const answer = await call("POST", `/scenarios/check${this.query()}`, body).catch((error) => error);
      if (answer instanceof Error) this.fail(answer.message, body);
      else this.tell(answer, body);
      await pause;
    }
    this.busy = false;
  }
}
