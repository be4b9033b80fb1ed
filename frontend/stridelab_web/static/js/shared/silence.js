// Notices that a stream has sent nothing for a while: a network that carries nothing does not end a connection.
export class Silence {
  // `onSilence()` is called after every `limit_ms` without a call of `interrupt`.
  /** @param {number} limit_ms @param {() => void} onSilence */
  constructor(limit_ms, onSilence) {
    this.limit_ms = limit_ms;
    this.onSilence = onSilence;
    this.timer = 0;
    this.interrupt();
  }

  interrupt() {
    this.stop();
    this.timer = setTimeout(() => {
      this.interrupt();
      this.onSilence();
    }, this.limit_ms);
  }

  stop() {
    clearTimeout(this.timer);
  }
}
