"use strict";
// The link to the server.  When it breaks it tries again by itself, for ever; the server then sends everything
// again, so a page never has to remember what it missed.
class Link {
  static POSES = 1;
  static DRAWING = 2;

  constructor(receiver) {
    this.receiver = receiver; // { hello, history, state, refused, draw, pose, offline }
    this.pause = 250;
    this.open();
  }

  open() {
    const address = new URL("socket", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    address.search = location.search;
    address.hash = "";
    const socket = (this.socket = new WebSocket(address));
    socket.binaryType = "arraybuffer";
    socket.addEventListener("open", () => {
      this.pause = 250;
    });
    socket.addEventListener("message", ({ data }) => this.receive(data));
    socket.addEventListener("close", () => {
      this.receiver.offline();
      setTimeout(() => this.open(), this.pause);
      this.pause = Math.min(2000, 1.5 * this.pause);
    });
  }

  receive(data) {
    if (typeof data === "string") {
      const { type, ...content } = JSON.parse(data);
      this.receiver[type]?.(content);
      return;
    }
    const [kind, stamp] = new Uint32Array(data, 0, 2);
    if (kind === Link.POSES) this.receiver.pose(new Float32Array(data, 8), stamp);
    if (kind === Link.DRAWING) this.receiver.draw(new Uint8Array(data, 8));
  }

  get connected() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  send(command) {
    if (this.connected) this.socket.send(JSON.stringify(command));
  }
}
