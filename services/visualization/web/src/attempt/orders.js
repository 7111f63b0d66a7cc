// Orders of the attempt, with the session's token: begin again, pause, slow motion; the page shows their result.

import { order, unanswered } from "../command.js";
import { said } from "../school/i18n.js";

export class Orders {
  // onSaid(text, ok): what the rig answers
  constructor(onSaid) {
    this.onSaid = onSaid;
    this.token = null;
  }

  ask(what, value = 0) {
    return this.post("api/attempt", JSON.stringify({ what, value }));
  }

  // Returns what the rig answered: whether it does it, and its sentence, in the language chosen.
  async post(address, body) {
    if (!this.token) return this.say("Open the address that trocar up printed, with its #token=…, to do that.", false);
    try {
      const answer = await fetch(address, order(this.token, body));
      const found = await answer.json();
      return this.say(found.text ?? found.error, answer.ok);
    } catch (error) {
      return this.say(unanswered(error, "The rig is not reachable: nothing was done."), false);
    }
  }

  say(sentence, ok) {
    const text = said(sentence);
    this.onSaid(text, ok);
    return { text, ok };
  }
}
