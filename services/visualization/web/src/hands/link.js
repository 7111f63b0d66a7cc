// The WebSocket that carries the hands to the rig: the session's token, a greeting, then where the hands are.

export class HandLink {
  // handlers: onGreeting(message), onEnd(reason)
  constructor(viewAddress, token, handlers) {
    this.socket = new WebSocket(viewAddress.replace(/\/ws$/, "/hands"));
    this.socket.onopen = () => this.socket.send(token);
    this.socket.onmessage = ({ data }) => handlers.onGreeting(JSON.parse(data));
    this.socket.onclose = ({ reason }) => handlers.onEnd(reason || "The view is not reachable.");
    this.last = "";
    this.quiet = 0;
  }

  // Sends changes, and now and then the unchanged pose, so that the rig knows that the page is alive.
  // `begins`: number of restarts of the scene, from the greeting: the rig ignores hands of an earlier one.
  // `hz`: pictures a second that this page shows, by which the rig knows whether an attempt can count; -1: not known.
  send(grips, begins, hz = -1) {
    const text = JSON.stringify([grips.map((grip) => grip.row()), begins, hz]);
    if (this.socket.readyState !== WebSocket.OPEN || (text === this.last && ++this.quiet < 10)) return;
    this.last = text;
    this.quiet = 0;
    this.socket.send(text);
  }

  close() {
    this.socket.onclose = null;
    this.socket.close();
  }
}
